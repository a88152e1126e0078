"""The process that owns the gateway's public port: it stops the robot, sends heartbeats, and passes on all the rest."""
