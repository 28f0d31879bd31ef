"""Files that MAVLink FTP serves."""
