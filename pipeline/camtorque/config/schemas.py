"""Every key of every TOML file that the product reads, with unit, default, allowed band and reason: the one place.

The bands are wide: a value outside is not unusual but a slip (millimetres in a key of metres). Slips inside the bands
are found by the cross-checks of `camtorque.ingest.pump_sizes` and `plausibility`.
"""

from __future__ import annotations

from dataclasses import replace

from camtorque.config.keys import Band, Key, TableSchema
from camtorque.config.quantities import CHANNEL_QUANTITIES, LIQUID_C

RECORDING_FILE = "recording.toml"
RECORDING_SCHEMA = "fip-bench-recording/1"
PUMP_SCHEMA = "camtorque-pump/1"


def words(*names: str) -> dict[str, str]:
    """Return a choice of words that stand for themselves."""
    return {name: name for name in names}


ROTATIONS = {"positive": 1, "negative": -1}
STEEL = "from plastics to tungsten carbide"
SENSE = "amplifiers put out at most 15 V"
IDLE = "no recording is longer"
ANGLE = Band(-720.0, 720.0, "two revolutions at most")
CAM_SPEED = Band(1.0, 30_000.0, "no bench turns a cam faster than some 10000 rpm")
SENSOR_DELAY = Band(
    0.0, 0.1, "amplifiers take microseconds to 2 milliseconds, telemetry and digital filters up to 0.1 s"
)
SWITCH_DELAY = Band(0.0, 5e-3, "proximity switches take microseconds to a few milliseconds")

IDLE_KEYS = (
    Key("idle_from_s", "number", "begin of a stretch at standstill, after a channel's first sample; gives the zero",
        "s", None, Band(0.0, 1e6, IDLE), own=True),
    Key("idle_to_s", "number", "end of that stretch", "s", None, Band(1e-6, 1e6, IDLE), own=True),
)  # fmt: skip
DURATION = Key("duration_s", "number", "how long a log should be; one that differs is a finding", "s", None,
               Band(1e-3, 1e7, "from a millisecond to months"), own=True)  # fmt: skip

RECORDING = TableSchema("[recording]", "what was recorded", (
    Key("id", "text", "name of the recording"),
    Key("pump_id", "text", "name of the pump; recordings of one pump are fitted together", default=""),
    Key("nominal_speed_rpm", "number", "cam speed, roughly", "rpm", band=CAM_SPEED),
    Key("file_format", "text", "format of the logs; found by their content where left out", default=""),
    Key("csv_dialect", "text", 'a hint such as "semicolon, decimal comma"; the file decides', default=""),
    Key("acquisition", "text", "how it was logged", default="", used=False),
    Key("rotation", "choice", "sense of rotation; negative turns the sign of the torque", default=1,
        choices=ROTATIONS),
    Key("note", "text", "anything", default="", used=False),
    Key("group", "text", "recordings of one group are fitted together (before and after are two)", default="",
        own=True),
    Key("date", "date", "day of the recording, where the logs do not tell", default=None, own=True),
    *IDLE_KEYS,
    DURATION,
))  # fmt: skip

CAM_TABLE_KEYS = (
    Key("cam_table", "path", "measured lift table (CSV or xlsx)", attribute="cam_table_path"),
    Key("cam_table_angle_column", "text", "its angle; the unit ends the name (_deg, _rad) or stands in a unit row",
        default="cam_angle_deg"),
    Key("cam_table_lift_column", "text", "its lift; the unit ends the name (_mm, _m, _um) or stands in a unit row",
        default="lift_mm"),
    Key("cam_table_zero_deg", "number",
        "angle in the table at which the lift starts, where that is not its zero; taken off its angles and off "
        "nominal_angle_deg", "deg", 0.0, ANGLE, attribute="cam_table_zero"),
)  # fmt: skip
PUMP = TableSchema("[pump]", "catalogue values of the pump; `run` needs them, `align` does not", (
    Key("base_circle_radius_m", "number", "cam radius at zero lift", "m",
        band=Band(0.003, 0.5, "cams of pumps measure 6 mm to 1 m")),
    Key("roller_radius_m", "number", "radius of the follower's roller", "m",
        band=Band(0.001, 0.3, "rollers measure 2 mm to 0.6 m")),
    Key("roller_width_m", "number", "length of the contact line", "m",
        band=Band(0.0005, 0.5, "rollers are 0.5 mm to 0.5 m wide")),
    Key("follower_offset_m", "number", "distance of the follower's line from the cam axis", "m", 0.0,
        Band(-0.2, 0.2, "an offset is smaller than the cam")),
    Key("cam_mass_kg", "number", "mass of the cam", "kg", band=Band(1e-3, 2000.0, "from a model to a ship's camshaft")),
    Key("cam_inertia_kg_m2", "number", "moment of inertia of the cam about its axis", "kg_m2",
        band=Band(1e-9, 20.0, "a ship's camshaft has less")),
    Key("follower_mass_kg", "number", "all sliding parts, roller and a third of the spring included", "kg",
        band=Band(1e-4, 300.0, "a ship's follower weighs less")),
    Key("follower_mass_note", "text", "what the mass holds", default="", used=False),
    Key("spring_stiffness_N_per_m", "number", "rate of the return spring", "N_per_m",
        band=Band(200.0, 2e7, "return springs have 0.2 to 20 000 N/mm", or_zero=True)),
    Key("spring_preload_N", "number", "its force at zero lift", "N",
        band=Band(0.0, 2e5, "follower springs are preloaded less")),
    Key("plunger_diameter_m", "number", "diameter of the plunger", "m",
        band=Band(0.001, 0.1, "plungers measure 1 to 100 mm")),
    Key("youngs_modulus_cam_Pa", "number", "of the cam", "Pa", band=Band(1e9, 1.2e12, STEEL)),
    Key("youngs_modulus_roller_Pa", "number", "of the roller", "Pa", band=Band(1e9, 1.2e12, STEEL)),
    *CAM_TABLE_KEYS,
    Key("poisson_ratio", "number", "of cam and roller", default=0.3, band=Band(0.05, 0.499, "of solids"), own=True),
    Key("roller_mass_kg", "number", "literature values are used where it is not given", "kg", None,
        Band(1e-6, 100.0, "a roller is lighter than its follower", or_zero=True), own=True),
    Key("roller_inertia_kg_m2", "number",
        "about its pin; literature values where not given; 0: a foot that slides, roller_radius_m is that of its crown",
        "kg_m2", None,
        Band(1e-12, 5.0, "a ship's roller has less", or_zero=True), own=True),
), required=False)  # fmt: skip

TRIGGER = TableSchema("[trigger]", "what tells the cam angle", (
    Key("nominal_angle_deg", "number",
        "cam angle at which the edge comes (of tooth 1 after the mark), or of the zero of a recorded angle", "deg",
        band=ANGLE),
    Key("installation_tolerance_deg", "number", "half width of its mounting tolerance", "deg",
        band=Band(0.0, 180.0, "beyond half a revolution nothing is known")),
    Key("meaning", "text",
        "what happens at that angle; an end of pre-stroke or start of pressurisation is held against the lift table",
        default=""),
    Key("edge", "choice", "the edge that counts", default="rising", choices=words("rising", "falling")),
    Key("pulses_per_rev", "whole", "teeth, missing ones counted as if present", default=1,
        band=Band(1, 100_000, "encoders have fewer lines")),
    Key("level_V", "number", "height of the pulse; the logs tell it", "V", None,
        Band(0.0, 500.0, "sensors give fewer volts"), used=False),
    Key("switching_delay_typ_s", "number", "delay of the switch", "s", 0.0, SWITCH_DELAY, attribute="switching_delay"),
    Key("missing_teeth", "whole", "teeth left out at the mark of a tooth wheel", default=0,
        band=Band(0, 1000, "a mark has fewer teeth"), own=True),
    Key("double_tooth", "flag", "one extra tooth marks the revolution", default=False, own=True),
    Key("sensor", "choice", "how it senses: logic pulses, an inductive coil (amplitude grows with speed), or Hall",
        default="digital", choices=words("digital", "inductive", "hall"), own=True),
    Key("revolutions_per_cycle", "whole", "turns of the wheel per turn of the cam (2 for a crank wheel)", default=1,
        band=Band(1, 16, "gears of pump drives are lower"), own=True),
    Key("side", "choice", "on the camshaft, or on the motor's side of the shaft", default="cam",
        choices=words("cam", "motor"), own=True),
    Key("reference", "choice", "`index`: the nominal angle is that of the `index` channel's pulse; taken so wherever "
        "even pulses have no mark of their own", default="",
        choices=words("index"), own=True),
))  # fmt: skip

ACCURACY = Band(1e-4, 50.0, "sensors are worse than 1 ppm and better than half their range")
SHEET_KEYS = (
    Key("type", "text", "maker and model", default=""),
    Key("unit", "text", "unit of range and sensitivity", default=""),
    Key("reference", "choice", "zero of a pressure sensor", default="gauge", choices=words("gauge", "absolute")),
    Key("nominal_range", "pair", "[lowest, highest] value in the unit of the sensor", default=None,
        band=Band(-1e9, 1e9, "of any sensor")),
    Key("output_range_V", "pair", "output at the ends of the range", "V", None,
        Band(-100.0, 100.0, "of any amplifier")),
    Key("nominal_sensitivity_V_per_unit", "number", "held against the certificate", default=None,
        band=Band(-1e6, 1e6, "of any sensor")),
    Key("sensitivity_V_per_unit", "number", "gain where there is no certificate", default=None,
        band=Band(-1e6, 1e6, "of any sensor"), own=True),
    Key("sensitivity_mV_per_V", "number", "of a bridge (channel in mV/V): its output at the upper end of nominal_range",
        "mV_per_V", None, Band(-50.0, 50.0, "bridges give 0.5 to 10 mV/V"), attribute="bridge_sensitivity", own=True),
    Key("unit_per_mV_per_V", "number", "of a bridge, in place of that: its unit per mV/V, such as 50 N m", default=None,
        band=Band(-1e6, 1e6, "of any sensor"), own=True),
    Key("zero_mV_per_V", "number", "output of a bridge at zero load where there is no certificate", "mV_per_V", None,
        Band(-50.0, 50.0, "bridges give 0.5 to 10 mV/V"), attribute="bridge_zero", own=True),
    Key("zero_V", "number", "output at zero load where there is no certificate", "V", None,
        Band(-100.0, 100.0, "of any amplifier"), own=True),
    Key("accuracy_class", "number", "percent of the range", default=None, band=ACCURACY),
    Key("accuracy_percent_fs", "number", "percent of the range", default=None, band=ACCURACY),
    Key("cutoff_hz", "number", "-3 dB frequency of the low-pass", "hz", None,
        Band(1.0, 1e8, "low-passes of amplifiers"), attribute="cutoff_hz"),
    Key("filter", "text", 'kind and order, such as "low-pass, 4th order, Bessel"', default=""),
    Key("natural_frequency_hz", "number", "of the sensing element", "hz", None,
        Band(1.0, 1e9, "of any sensor"), attribute="natural_frequency_hz"),
    Key("group_delay_s", "number", "total delay of sensor and amplifier, low-pass included", "s", None, SENSOR_DELAY),
    Key("group_delay_note", "text", 'its tolerance, such as "+/-3 %"', default=""),
    Key("zero_tolerance_V", "number", "half width of the zero", "V", None, Band(0.0, 10.0, "of any amplifier")),
    Key("zero_drift_note", "text", 'such as "0.15 % of range"', default=""),
    Key("residual_ripple_V", "number", "noise of the output", "V", None, Band(0.0, 10.0, "of any amplifier")),
    Key("span_drift_percent", "number", "drift of the gain", default=0.0, band=Band(0.0, 50.0, "of any sensor")),
    Key("calibration_date", "date", "day of the certificate", default=None),
)  # fmt: skip
SHEET = TableSchema("[sensor]", "the sheet of a sensor", (
    Key("serial", "text", "serial number"),
    Key("quantity", "text", "what it measures"),
    *SHEET_KEYS,
    Key("certificate", "path", "table of calibration points", default=None),
))  # fmt: skip

SENSOR = TableSchema("[sensors.*]", "a sensor: its sheet by `calibration`, or the sheet's keys right here", (
    Key("serial", "text", "serial number", default=""),
    Key("calibration", "path", "sheet of the sensor", default=None, attribute="calibration_path"),
    Key("location", "text", "where it sits: a pressure sensor in the `chamber` measures what acts on the plunger; one "
        "more than `50 mm` along the line is told, which the model does not hold",
        default=""),
    Key("zero_before_V", "number", "reading at standstill before the run", "V", None, Band(-15.0, 15.0, SENSE),
        attribute="zero_before_volts"),
    Key("zero_after_V", "number", "reading at standstill after the run", "V", None, Band(-15.0, 15.0, SENSE),
        attribute="zero_after_volts"),
    Key("zero_before", "number", "the same in the unit of the channel, where that is not volts", default=None,
        band=Band(-1e6, 1e6, "of any sensor"), own=True),
    Key("zero_after", "number", "the same after the run", default=None, band=Band(-1e6, 1e6, "of any sensor"),
        own=True),
    *IDLE_KEYS,
    *SHEET_KEYS,
), required=False)  # fmt: skip

LOGGER = TableSchema("[[loggers]]", "clocks; one logger with one clock where left out", (
    Key("id", "text", "name of the logger"),
    Key("clock", "choice", "single: one clock; synchronised: own start on a common clock; independent: own clock",
        default="single", choices=words("single", "synchronised", "independent")),
), required=False, many=True)  # fmt: skip

CHANNEL = TableSchema("[[channels]]", "where each quantity lies", (
    Key("quantity", "choice", "what it measures", choices=words(*CHANNEL_QUANTITIES)),
    Key("file", "path", "log that holds it", attribute="path"),
    Key("group", "text", "group, sheet or struct in the file, if any", default=""),
    Key("channel", "text", "name of column, channel, data set or variable; `column 3` where a table has no names"),
    Key("unit", "text", "`V`, `mV`, `mV/V` or a unit of the quantity where the logger has scaled already"),
    Key("logger", "text", "whose clock it is on; the only logger where left out", default=""),
    Key("sample_rate_hz", "number", "held against what the file says", "hz",
        band=Band(0.01, 1e9, "shafts turn faster, loggers sample slower"), attribute="sample_rate"),
    Key("sensor", "text", "serial number, held against the sensor table", default=""),
    Key("used", "flag", "`false`: described, but left out; of two channels of one quantity one is used", default=True,
        own=True),
    Key("time_channel", "text", "column, variable or channel that holds its times", default="", own=True),
    Key("supply_channel", "text", "of a bridge in mV: channel in its group with its supply in V, mV/V sample by sample",
        default="", own=True),
    Key("start_time_s", "number", "time of its first sample where the file holds no date", "s", None,
        Band(-1e10, 1e10, "of any clock"), own=True),
    DURATION,
), many=True)  # fmt: skip

FLUID = TableSchema("[fluid]", "the fuel or oil, where known", (
    Key("name", "text", "diesel, ISO 4113, gasoline, methanol, kerosene, HVO, marine, heavy fuel, DME, glycol",
        default="", own=True),
    Key("temperature_C", "number", "at the pump inlet, where no `fuel_temperature` channel tells", "C", None,
        Band(*LIQUID_C, "liquid fuel"), own=True),
    Key("bulk_modulus_Pa", "number", "at feed pressure", "Pa", None, Band(1e8, 6e9, "of liquids"), own=True),
    Key("bulk_modulus_slope", "number", "its rise per rise of pressure", default=None,
        band=Band(3.0, 30.0, "of liquids: 8 to 14"), own=True),
    Key("feed_pressure_bar", "number", "gauge", "bar", None, Band(-1.0, 200.0, "of feed pumps"), own=True),
), required=False)  # fmt: skip
DRIVE = TableSchema("[drive]", "what turns the pump, where known", (
    Key("kind", "choice", "the machine that drives", default="", own=True, used=False,
        choices=words("servo", "flywheel", "induction", "synchronous", "dc", "engine", "hydraulic")),
    Key("inertia_kg_m2", "number", "drive side of the torque transducer, flywheel included", "kg_m2", None,
        Band(1e-6, 1e5, "from a model motor to a ship's engine"), own=True),
    Key("speed_loop_Hz", "number", "bandwidth of the speed control", "Hz", None, Band(1e-3, 5e3, "of drives"),
        own=True),
    Key("shaft_stiffness_Nm_per_rad", "number", "from the drive to the cam", "Nm_per_rad", None,
        Band(1.0, 1e9, "from a rubber coupling to a ship's shaft"), own=True),
), required=False)  # fmt: skip

RECORDING_TABLES = {
    table.header.strip("[].*"): table for table in (RECORDING, PUMP, TRIGGER, SENSOR, LOGGER, CHANNEL, FLUID, DRIVE)
}
"""Tables of recording.toml by their names."""

SECTION = TableSchema("[[cam.sections]]", "the cam in sections along the direction of running", (
    Key("kind", "text", "law of the section, see predict.md"),
    Key("angle_deg", "number", "its length; a tangent lobe takes what it needs", "deg", None,
        Band(1e-6, 360.0, "a revolution at most"), attribute="angle"),
    Key("rise_mm", "number", "lift gained, negative on the return", "mm", None,
        Band(-300.0, 300.0, "of any cam"), attribute="rise"),
    Key("nose_radius_mm", "number", "of a tangent lobe", "mm", None, Band(0.01, 500.0, "of any cam"),
        attribute="nose_radius"),
), many=True)  # fmt: skip
PUMP_FILE_TABLES: dict[str, TableSchema] = {
    "pump": TableSchema("[pump]", PUMP.meaning, (
        Key("id", "text", "name of the pump", default="", used=False),
        Key("note", "text", "anything", default="", used=False),
        *(replace(key, default=None) if key.name == "cam_table" else key for key in PUMP.keys),
    )),
    "cam": TableSchema("[cam]", "the cam by its law, in place of a lift table", (
        Key("start_deg", "number", "cam angle at which the first section begins", "deg", 0.0, ANGLE,
            attribute="sections_start"),
    ), required=False),
    "cam.sections": SECTION,
    "mounting": TableSchema("[mounting]", "how the pump is mounted", (
        Key("rotation", "choice", "sense of rotation", default=1, choices=ROTATIONS),
        Key("gravity_m_per_s2", "pair", "along X1 and Y1", "m_per_s2", (0.0, 0.0), Band(-20.0, 20.0, "on earth"),
            attribute="gravity"),
        Key("spring_mass_kg", "number", "of the return spring", "kg", 0.0, Band(0.0, 100.0, "of any spring")),
        Key("guide_height_m", "number", "middle of the guide above the cam's axis", "m", None,
            Band(-2.0, 2.0, "a follower is shorter")),
    ), required=False),
    "shaft": TableSchema("[shaft]", "several pumps on one shaft", (
        Key("phases_deg", "numbers", "lag of each pump's lobe", "deg", (0.0,), ANGLE),
        Key("stiffness_N_m_per_rad", "number", "of each piece of shaft between lobes; rigid where left out",
            "N_m_per_rad", float("inf"), Band(1.0, 1e9, "from rubber to a ship's shaft"),
            attribute="shaft_stiffness"),
        Key("damping_N_m_s_per_rad", "number", "of each piece of shaft", "N_m_s_per_rad", 0.0,
            Band(0.0, 1e6, "of any shaft"), attribute="shaft_damping"),
    ), required=False),
    "friction": TableSchema("[friction]", "friction of the pump; none where left out", (
        Key("guide", "number", "coefficient of the follower in its guide", default=0.0,
            band=Band(0.0, 0.999, "a guide with more jams")),
        Key("bearing_arm_um", "number", "coefficient times radius of the camshaft bearings", "um", 0.0,
            Band(0.0, 1e5, "of any bearing")),
        Key("pin_arm_um", "number", "coefficient times radius of the roller pin, or of a foot that slides", "um", 0.0,
            Band(0.0, 1e5, "of any pin")),
    ), required=False),
}  # fmt: skip
"""Tables of a pump file."""

CERTIFICATE_COLUMNS: dict[str, str] = {
    "applied_<quantity>_<unit>": "load of each point, in the unit of the sheet",
    "output_<unit>": "what the sensor gave",
}
"""Columns of a certificate."""
