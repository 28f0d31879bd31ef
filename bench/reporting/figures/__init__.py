"""The figures: pure functions from data to Plotly figures."""
