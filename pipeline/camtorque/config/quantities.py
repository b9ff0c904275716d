"""What a channel can measure: each quantity once, with the dimension of its units and what it needs."""

from __future__ import annotations

from dataclasses import dataclass

from camtorque.units import BORDER_UNITS, DEGREE, RPM, ZERO_CELSIUS, tidy_unit, unit_factor


@dataclass(frozen=True)
class ChannelQuantity:
    """One quantity of a channel.

    Attributes
    ----------
    dimension : dimension of its units, see `camtorque.units.BORDER_UNITS`
    unit : SI unit of its samples once read
    shown_unit, shown_factor, shown_offset : unit for people, that unit per SI, and what it shows at 0 in SI
    meaning : one line
    is_pulse : True where edges carry the information: volts or logic levels, no sensor sheet
    """

    dimension: str
    unit: str
    shown_unit: str
    shown_factor: float
    meaning: str
    is_pulse: bool = False
    shown_offset: float = 0.0


CHANNEL_QUANTITIES: dict[str, ChannelQuantity] = {
    "torque": ChannelQuantity("torque", "N m", "N m", 1.0, "torque in the drive shaft"),
    "pressure": ChannelQuantity("pressure", "Pa", "bar", 1e-5, "pressure in the high-pressure line, pump end"),
    "trigger": ChannelQuantity("voltage", "V", "V", 1.0, "pulses of the proximity trigger or tooth wheel", True),
    "index": ChannelQuantity("voltage", "V", "V", 1.0, "one pulse per revolution beside the trigger", True),
    "encoder_a": ChannelQuantity("voltage", "V", "V", 1.0, "track A of an encoder", True),
    "encoder_b": ChannelQuantity("voltage", "V", "V", 1.0, "track B of an encoder", True),
    "angle": ChannelQuantity("angle", "rad", "deg", 1.0 / DEGREE, "recorded angle, counted on or per revolution"),
    "fuel_temperature": ChannelQuantity("temperature", "K", "°C", 1.0, "temperature of the fuel", False, -ZERO_CELSIUS),
    "housing_temperature": ChannelQuantity(
        "temperature", "K", "°C", 1.0, "temperature of the housing", False, -ZERO_CELSIUS
    ),
    "chamber_pressure": ChannelQuantity("pressure", "Pa", "bar", 1e-5, "pressure above the plunger"),
    "gallery_pressure": ChannelQuantity("pressure", "Pa", "bar", 1e-5, "feed pressure in the suction gallery"),
    "delivered_volume": ChannelQuantity("volume", "m3", "mm3", 1e9, "volume delivered per stroke"),
    "shaft_speed": ChannelQuantity("speed", "rad/s", "rpm", 1.0 / RPM, "speed of the shaft"),
    "needle_lift": ChannelQuantity("length", "m", "mm", 1e3, "lift of the injector needle"),
}
"""Quantity of a channel -> what it is."""

ANGLE_QUANTITIES = ("trigger", "index", "encoder_a", "angle")
"""At least one of these is needed to know the cam angle."""
SENSOR_QUANTITIES = tuple(name for name, quantity in CHANNEL_QUANTITIES.items() if not quantity.is_pulse)
"""Quantities that a sensor with a sheet may measure."""
SHEET_NEEDED = ("torque", "pressure", "chamber_pressure")
"""Quantities whose delay and accuracy the model needs: without a sheet they are assumed, and a finding says so."""
LIQUID_C = (-60.0, 250.0)
"""Lowest and highest temperature of a liquid fuel [deg C]: what lies outside is a broken wire or another unit."""
SENSED = ("voltage", "bridge output")
"""Dimensions of what a sensor gives before anything scales it."""


def channel_factor(quantity: str, unit: str, where: str) -> tuple[float, bool]:
    """Return the factor from a channel's unit to volts, mV/V or SI, and whether it is what a sensor gives (not scaled).

    Raises
    ------
    Refusal : the unit is unknown, or neither of voltage, a bridge's output nor of the quantity
    """
    known = CHANNEL_QUANTITIES[quantity]
    kind = BORDER_UNITS.get(tidy_unit(unit), ("", 1.0))[0]
    if known.is_pulse and kind == "level":
        return 1.0, False
    also = SENSED[:1] if known.is_pulse else SENSED
    return unit_factor(unit, known.dimension, where, *also), kind in SENSED
