"""What to check if a device sends nothing, or if its data are damaged."""

from collections.abc import Mapping

from mercator_design.robot.devices.ports import DeviceName

NEVER_HEARD: Mapping[DeviceName, str] = {
    "rvr": "is it switched on, charged and awake? Is its UART on (as sold it is off; an update with the app Sphero Edu "
    "turns it on), and this computer's at 115200 baud whatever its clock (enable_uart=1)? Are TX and RX crossed? Is a "
    "login shell on the port (raspi-config)? Do its lamps flash yellow (more than 2.15 A; switch it off and on)? Does "
    "the UART work (run `mercator-robot check` with TX and RX joined in place of the RVR)?",
    "lidar": "has it power (5 V, 1 A, and more while its motor starts)? Is it an X4, which sends at 128000 baud?",
    "proximity": "is this the hub's port (`mercator-robot install` gives it a name that stays), and are all sensors "
    "plugged in?",
}
HEARD_BEFORE: Mapping[DeviceName, str] = {
    "rvr": "it was heard before: has it still power, is a wire loose, or is this computer too busy?",
    "lidar": "it was heard before: has it power (5 V, 1 A, and more while its motor starts), does its motor turn, is a "
    "cable loose, or is this computer too busy?",
    "proximity": "it was heard before: are all sensors plugged in, is its cable loose, or is this computer too busy?",
}
DAMAGED_LINE: Mapping[DeviceName, str] = {
    "rvr": "is its cable loose, too long, or beside one of a motor, and is this computer's UART at 115200 baud "
    "whatever its clock (enable_uart=1)?",
    "lidar": "is its cable loose, too long, or beside one of a motor, and is it an X4, which sends at 128000 baud?",
    "proximity": "is its USB cable loose, too long, or beside one of a motor?",
}
JOINED = "what is sent comes back: the UART works, and its TX and RX are joined; connect them to RX and TX of the RVR"
