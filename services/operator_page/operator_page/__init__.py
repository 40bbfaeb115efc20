"""Page in a browser on which an operator sets up, watches, decides, stops and reports."""
