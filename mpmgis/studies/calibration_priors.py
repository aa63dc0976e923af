"""Prior distributions of calibrated keys: shipped ranges by material, or the user's distributions."""

from ..system.errors import InputError
from .varied_keys import Spread, variation

# Ranges of calibrated Voellmy parameters: docs/limits.md and laws.friction.Voellmy
RANGES = {
    "snow-avalanche": {"friction.mu": "0.15:0.4", "friction.xi": "1000:3000"},
    "debris-flow": {"friction.mu": "0.05:0.2", "friction.xi": "100:500"},
    "rock-avalanche": {"friction.mu": "0.1:0.3", "friction.xi": "300:1500"},
}


def priors(vary: tuple | dict, material: str | None) -> dict[str, Spread]:
    """Return the prior distribution of each calibrated key.

    Parameters
    ----------
    vary : tuple of str, or dict
        KEY=DISTRIBUTION, or KEY for the range of the `material`; a dictionary has None there.
    material : str or None
        Key of RANGES.

    Raises
    ------
    InputError
        No key, a key twice or without a distribution, or values that are a list: intervals need a distribution.
    """
    pairs = list(vary.items()) if isinstance(vary, dict) else [_pair(text) for text in vary]
    if not pairs:
        raise InputError("nothing is calibrated; give for example `vary=friction.mu=0.1:0.4`")
    found = {}
    for key, asked in pairs:
        if key in found:
            raise InputError(f"`vary={key}` is given twice; give it once")
        made = variation(_range_of(key, material) if asked is None else asked, f"`vary={key}`")
        if not isinstance(made, Spread):
            raise InputError(f"`vary={key}={asked}` is a list; expected a distribution, for example {key}=0.1:0.4")
        found[key] = made
    return found


def _pair(text):
    key, equals, values = text.partition("=")
    return key.strip(), values if equals else None


def _range_of(key, material):
    if material is None:
        raise InputError(f"`vary={key}` has no distribution; give {key}=LOW:HIGH, or `material` for its range")
    known = RANGES[material]
    if key not in known:
        raise InputError(
            f"`material={material}` has no range of {key}, only of {', '.join(known)}; give {key}=LOW:HIGH"
        )
    return known[key]
