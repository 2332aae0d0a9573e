"""Cameras and sensors."""
