"""Many cycles at once: what states show, as arrays with a leading axis of cycles."""
