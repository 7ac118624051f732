"""Jobs: each is one race in one run folder, or one study in the folder of a study."""
