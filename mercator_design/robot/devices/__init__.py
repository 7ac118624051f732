"""The devices behind the serial ports: settings, opening, starting, measurements, health of lines."""
