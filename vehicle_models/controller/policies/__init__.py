"""What an autopilot must define: eight policies, each a frozen value that is given to the services that ask it.

`px4/` and `ardupilot/` hold the same eight file names. What is plain data stands in tables here, with a column for each
autopilot: `choices.csv` (fields of the policies), `commands.csv` and `messages.csv`. Another autopilot is another folder,
and another column.
"""
