"""Pictures: layered EXR and PNG, plates and holdouts, display, swatches of looks."""
