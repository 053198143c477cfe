"""Light: diffuse transfer with shadows, light fitted to frames, and shading that follows the surface.

- `transfer.light_transfer`: how much light from each direction reaches each vertex
- `fitting.observe_skin`, `fit_light`: the light of a capture from the colours of skin
- `Shading`, `relight`: factors on colours from the irradiance of one surface to that of another
"""

from carigs.light.fitting import Observation, fit_light
from carigs.light.shading import Shading, irradiance_ratio, relight
from carigs.light.transfer import fibonacci_sphere, light_transfer

__all__ = ["Observation", "Shading", "fibonacci_sphere", "fit_light", "irradiance_ratio", "light_transfer", "relight"]
