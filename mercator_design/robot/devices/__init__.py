"""The devices at the serial ports: settings, ports, start-up, measurements, health of lines."""
