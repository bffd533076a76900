"""What one browser session has chosen, and its form in links."""
