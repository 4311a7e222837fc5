"""What all tests share."""

from hypothesis import settings

# The same examples in every run, and no deadlines: a slow machine is no bug.
# To search for new examples: ./test.bash --hypothesis-profile=search
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile("search", deadline=None, max_examples=1000)
settings.load_profile("repeatable")
