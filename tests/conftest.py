from hypothesis import settings

# A first example may compile a kernel, so its time says nothing.
settings.register_profile("project", deadline=None)
settings.load_profile("project")
