"""Forces of many units to what touches the skin."""
