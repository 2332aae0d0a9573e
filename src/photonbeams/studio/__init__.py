"""The studio: a shot that is rendered while it is edited, and the page that shows it."""

from .session import Picture, Session

__all__ = ["Picture", "Session"]
