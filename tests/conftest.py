"""Settings that hold for every test."""

from hypothesis import settings

# No deadlines: these machines are shared, and a slow example says nothing of the code. Failing examples are printed
# with what reproduces them.
settings.register_profile("distalock", deadline=None, print_blob=True)
settings.load_profile("distalock")
