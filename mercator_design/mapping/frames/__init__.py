"""Where the frames of robots that started at unknown places stand to each other."""
