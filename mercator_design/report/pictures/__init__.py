"""Pictures: missions from above."""
