"""Hair: which triangles of the head it covers, the space that it fills, and points inside it. The body is told from it.

- `find_hair`, `load_hair`, `FoundHair`: the hair of a capture
- `place_in_hair`: points inside it, for surfels
- `hair_reach`: how far it reaches from the scalp
- `CarriedHair`: where it is on a caricature
- `HairShadow`, `hair_shadow`: how much of the light it lets through
- `SpaceAboveSkin`: where no hair can be
"""

from carigs.hair.bare_skin import SpaceAboveSkin
from carigs.hair.carried_hair import CarriedHair
from carigs.hair.found_hair import FoundHair, find_hair, load_hair
from carigs.hair.hair_shadow import HairShadow, hair_shadow
from carigs.hair.placement import place_in_hair
from carigs.hair.reach import hair_reach

__all__ = [
    "CarriedHair",
    "FoundHair",
    "HairShadow",
    "SpaceAboveSkin",
    "find_hair",
    "hair_reach",
    "hair_shadow",
    "load_hair",
    "place_in_hair",
]
