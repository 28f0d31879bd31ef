"""What an autopilot must define: nine policies, each a frozen value that is given to the services that ask
it.

`px4/` and `ardupilot/` hold the same nine file names. Another autopilot is another such folder.
"""
