"""Where MediaPipe's landmarks lie on a head model.

- `landmark_embedding`: of a head that the package knows from its files, of any other one by `register_landmarks`
- `canonical_face`: the mesh whose vertices are the landmarks
- `outer_skin`, `anchors`: the openings of a head, and the places that follow from them
- `registration`: a mesh deformed until it lies on a surface
- `eyes`: eyeballs, and the landmarks of the irises on them
"""

from carigs.embedding.head_registration import register_landmarks
from carigs.embedding.known_heads import landmark_embedding
from carigs.embedding.landmarks import REGISTRATION, LandmarkEmbedding

__all__ = ["REGISTRATION", "LandmarkEmbedding", "landmark_embedding", "register_landmarks"]
