"""What an autopilot must define: eight policies, each a frozen value that is given to the services that ask
it.

`px4/` and `ardupilot/` hold the same eight file names. Another autopilot is another such folder.
"""
