"""Hair: which triangles of the head it covers, the space that it fills, and points inside it.

- `find_hair`, `load_hair`, `FoundHair`: the hair of a capture
- `place_in_hair`: points inside it, for surfels
- `hair_reach`: how far it reaches from the scalp
- `CarriedHair`: where it is on a caricature
- `SpaceAboveSkin`: where no hair can be
"""

from carigs.hair.bare_skin import SpaceAboveSkin
from carigs.hair.carried_hair import CarriedHair
from carigs.hair.found_hair import FoundHair, find_hair, load_hair
from carigs.hair.placement import place_in_hair
from carigs.hair.reach import hair_reach

__all__ = [
    "CarriedHair",
    "FoundHair",
    "SpaceAboveSkin",
    "find_hair",
    "hair_reach",
    "load_hair",
    "place_in_hair",
]
