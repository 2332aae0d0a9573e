"""The studio: sessions, in which a shot is rendered while it is edited, and the page and the widget that show them."""

from .session import Picture, Session

__all__ = ["Picture", "Session"]
