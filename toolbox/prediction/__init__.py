"""Motion under held inputs, for predictive laws."""
