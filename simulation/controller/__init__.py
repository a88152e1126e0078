"""The virtual hexapod controller: answers PI GCS 2.0 on TCP and on a pseudo-terminal, as the hardware would."""
