"""Ten real drives, with the figures of their public data sheets, each in a robot that it suits.

`sheet`: options of `terrapin robot new --from-sheet` that stand on the sheet; `robot`: those of the robot around it,
which are ours. `source`: where the figures were read, or that they are from memory of the sheet and were not looked up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["DRIVES", "Drive"]

MEMORY = "from memory of the maker's sheet, not looked up"
POLOLU = "Pololu 37D Metal Gearmotors, rev. 1.2, performance summary (studylib.es/doc/9384898, scribd 461460344)"
ROBOTIS = "emanual.robotis.com/docs/en/dxl"


@dataclass(frozen=True)
class Drive:
    source: str
    sheet: Mapping[str, str]
    robot: Mapping[str, str]

    @property
    def words(self) -> list[str]:
        """Options for the command line."""
        given = {**self.robot, **self.sheet}
        return [word for name, text in given.items() for word in (f"--{name.replace('_', '-')}", text)]


DRIVES: Mapping[str, Drive] = {
    "maxon_re30": Drive(
        MEMORY + " (RE 30, 310007, 60 W)",
        {"no_load_speed": "8810 rpm", "no_load_current": "164 mA", "stall_current": "39.3 A",
         "stall_torque": "1.02 N m", "resistance": "0.611 ohm", "inductance": "0.119 mH",
         "torque_constant": "25.9 mN m/A", "kv": "369 rpm/V", "rated_current": "3.44 A",
         "rotor_inertia": "33.5 g cm^2"},
        {"radius": "150 mm", "shell_mass": "1.2 kg", "body_mass": "2 kg", "drive_mass": "2.5 kg", "supply": "24 V",
         "gear": "14", "gear_efficiency": "0.75", "encoder_counts": "2000"},
    ),
    "maxon_re40": Drive(
        MEMORY + " (RE 40, 148867, 150 W)",
        {"no_load_speed": "7580 rpm", "no_load_current": "137 mA", "stall_current": "80.2 A",
         "stall_torque": "2.42 N m", "resistance": "0.299 ohm", "inductance": "0.082 mH",
         "torque_constant": "30.2 mN m/A", "kv": "317 rpm/V", "rated_current": "6 A", "rotor_inertia": "142 g cm^2"},
        {"radius": "220 mm", "drive_radius": "50 mm", "shell_mass": "3 kg", "body_mass": "5 kg", "drive_mass": "4 kg",
         "supply": "24 V", "gear": "14", "gear_efficiency": "0.75", "encoder_counts": "2000", "driver_current": "20 A"},
    ),
    "maxon_ec45_flat_70": Drive(
        "maxon catalogue, EC 45 flat 70 W, 651615 (online.flippingbook.com/view/1042987/324)",
        {"no_load_speed": "5600 rpm", "no_load_current": "270 mA", "stall_current": "42 A", "stall_torque": "1.69 N m",
         "resistance": "0.573 ohm", "inductance": "0.301 mH", "torque_constant": "40.4 mN m/A",
         "kv": "236 rpm/V", "rated_current": "3.29 A", "rotor_inertia": "181 g cm^2"},
        {"kind": "sphere", "radius": "0.2 m", "shell_mass": "3 kg", "frame_mass": "2 kg", "body_mass": "8 kg",
         "supply": "24 V", "gear": "66", "gear_efficiency": "0.7", "encoder_counts": "2048"},
    ),
    "maxon_ec45_flat_30": Drive(
        "maxon catalogue, EC 45 flat 30 W, 200142 (scribd.com/document/629363718)",
        {"no_load_speed": "4380 rpm", "no_load_current": "144 mA", "stall_current": "10 A", "rated_current": "2.03 A"},
        {"radius": "100 mm", "shell_mass": "0.5 kg", "body_mass": "0.7 kg", "drive_mass": "0.9 kg", "supply": "12 V",
         "gear": "6.6", "gear_efficiency": "0.8", "encoder_counts": "1024"},
    ),
    "pololu_37d_30": Drive(
        POLOLU + ", 4752, 12 V, 30:1",
        {"at": "output", "no_load_speed": "330 rpm", "no_load_current": "0.2 A", "stall_current": "5.5 A",
         "stall_torque": "14 kgf cm", "gear": "30", "encoder_counts": "64"},
        {"radius": "110 mm", "shell_mass": "0.55 kg", "body_mass": "0.6 kg", "drive_mass": "0.9 kg", "supply": "12 V"},
    ),
    "pololu_37d_19": Drive(
        POLOLU + ", 4751, 12 V, 18.75:1",
        {"at": "output", "no_load_speed": "530 rpm", "no_load_current": "0.2 A", "stall_current": "5.5 A",
         "stall_torque": "8.5 kgf cm", "gear": "18.75", "encoder_counts": "64"},
        {"radius": "90 mm", "shell_mass": "0.3 kg", "body_mass": "0.4 kg", "drive_mass": "0.5 kg", "supply": "12 V"},
    ),
    "faulhaber_1331t024sr": Drive(
        "Faulhaber, DC-Micromotors series 1331 ... SR (paperzz.com/doc/7782699); on 12 V, gear and encoder are ours",
        {"sheet_voltage": "24 V", "no_load_speed": "10400 rpm", "no_load_current": "5.5 mA",
         "stall_torque": "9.76 mN m", "resistance": "52.9 ohm", "inductance": "1100 uH",
         "torque_constant": "21.8 mN m/A", "kv": "439 rpm/V", "rated_current": "0.19 A",
         "rotor_inertia": "0.63 g cm^2"},
        {"radius": "60 mm", "shell_mass": "0.12 kg", "body_mass": "0.15 kg", "drive_mass": "0.1 kg", "supply": "12 V",
         "gear": "3.71", "gear_efficiency": "0.9", "encoder_counts": "1600"},
    ),
    "dynamixel_ax12a": Drive(
        f"{ROBOTIS}/ax/ax-12a, with the encoder of an XL430 behind the gear",
        {"at": "output", "encoder_at": "output", "no_load_speed": "59 rpm", "stall_current": "1.5 A",
         "stall_torque": "1.5 N m", "encoder_counts": "4096"},
        {"radius": "200 mm", "drive_radius": "130 mm", "shell_mass": "1.2 kg", "body_mass": "2.5 kg",
         "drive_mass": "0.4 kg", "supply": "12 V"},
    ),
    "dynamixel_2xl430": Drive(
        f"{ROBOTIS}/x/2xl430-w250",
        {"at": "output", "encoder_at": "output", "no_load_speed": "61 rpm", "stall_current": "1.4 A",
         "stall_torque": "1.5 N m", "encoder_counts": "4096"},
        {"radius": "200 mm", "drive_radius": "140 mm", "shell_mass": "1 kg", "body_mass": "2.5 kg",
         "drive_mass": "0.3 kg", "supply": "12 V"},
    ),
    "tmotor_u8": Drive(
        MEMORY + " (T-Motor U8, KV100)",
        {"kv": "100 rpm/V", "resistance": "0.186 ohm", "no_load_current": "0.6 A", "sheet_voltage": "20 V"},
        {"radius": "200 mm", "drive_radius": "50 mm", "shell_mass": "1.5 kg", "body_mass": "2 kg", "drive_mass": "1 kg",
         "supply": "24 V", "gear": "2", "gear_efficiency": "0.9", "encoder_counts": "4096", "driver_current": "20 A"},
    ),
}  # fmt: skip
