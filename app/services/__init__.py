"""What all sessions of a server process share."""
