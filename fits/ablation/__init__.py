"""What each gate, nicety and machine of the loop is worth: see README.md."""
