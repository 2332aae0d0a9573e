"""Studies of the estimators."""
