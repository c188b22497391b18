"""Many cycles at once: the contents of states, as arrays with a leading axis of cycles."""
