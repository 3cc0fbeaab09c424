"""Forecasts of the cost of a run, from measured costs."""
