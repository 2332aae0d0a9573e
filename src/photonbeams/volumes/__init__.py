"""Volume files: OpenVDB's .vdb and Mitsuba's .vol, read into NumPy arrays."""
