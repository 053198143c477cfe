"""Which of MediaPipe's 478 landmarks lie where: lips, eyes, irises, brows, nose and jaw line.

Numbers of the vertices of MediaPipe's canonical face mesh (468) and of the points of the irises (10) after them, as
MediaPipe's graphs and drawing styles list them. Left and right are those of the image of a person who faces the camera:
`LEFT_EYE` is the eye at the left of the image, the person's right one.
"""

from __future__ import annotations

COUNT = 478

MIDLINE = (
    *(0, 1, 2, 4, 5, 6, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19),
    *(94, 151, 152, 164, 168, 175, 195, 197, 199, 200),
)
_LEFT_HALF = tuple(i for i in range(248) if i not in MIDLINE)
_PAIRS = (*zip(_LEFT_HALF, range(248, 468), strict=True), (468, 473), (469, 476), (470, 475), (471, 474), (472, 477))
_PARTNERS = {i: i for i in MIDLINE} | dict(_PAIRS) | {right: left for left, right in _PAIRS}
MIRRORED = tuple(_PARTNERS[i] for i in range(COUNT))
"""The landmark of the other half of the face, for each. The mesh numbers both halves in the same order."""

LIPS = (
    *(61, 146, 91, 181, 84, 17, 314, 405, 321, 375, 291),  # outer contour: below, with both corners
    *(185, 40, 39, 37, 0, 267, 269, 270, 409),  # above
    *(78, 95, 88, 178, 87, 14, 317, 402, 318, 324, 308),  # inner contour: below, with both corners
    *(191, 80, 81, 82, 13, 312, 311, 310, 415),  # above
    *(76, 77, 90, 180, 85, 16, 315, 404, 320, 307, 306),  # between them, nearer to the outer one
    *(184, 74, 73, 72, 11, 302, 303, 304, 408),
    *(62, 96, 89, 179, 86, 15, 316, 403, 319, 325, 292),  # nearer to the inner one
    *(183, 42, 41, 38, 12, 268, 271, 272, 407),
)
"""The order of the network's output for the lips."""
LIPS_OUTER, LIPS_INNER = LIPS[:20], LIPS[20:40]

LEFT_EYE_REGION = (
    *(33, 7, 163, 144, 145, 153, 154, 155, 133),  # lower lid, with both corners
    *(246, 161, 160, 159, 158, 157, 173),  # upper lid
    *(130, 25, 110, 24, 23, 22, 26, 112, 243),  # rings around them
    *(247, 30, 29, 27, 28, 56, 190),
    *(226, 31, 228, 229, 230, 231, 232, 233, 244),
    *(113, 225, 224, 223, 222, 221, 189),
    *(35, 124, 46, 53, 52, 65),  # lower edge of the brow
    *(143, 111, 117, 118, 119, 120, 121, 128, 245),
    *(156, 70, 63, 105, 66, 107, 55, 193),  # upper edge of the brow
)
"""The order of the network's output for the eye; so is that of the other one."""
RIGHT_EYE_REGION = (
    *(263, 249, 390, 373, 374, 380, 381, 382, 362),
    *(466, 388, 387, 386, 385, 384, 398),
    *(359, 255, 339, 254, 253, 252, 256, 341, 463),
    *(467, 260, 259, 257, 258, 286, 414),
    *(446, 261, 448, 449, 450, 451, 452, 453, 464),
    *(342, 445, 444, 443, 442, 441, 413),
    *(265, 353, 276, 283, 282, 295),
    *(372, 340, 346, 347, 348, 349, 350, 357, 465),
    *(383, 300, 293, 334, 296, 336, 285, 417),
)
LEFT_EYE, RIGHT_EYE = LEFT_EYE_REGION[:16], RIGHT_EYE_REGION[:16]
LEFT_IRIS, RIGHT_IRIS = (468, 469, 470, 471, 472), (473, 474, 475, 476, 477)
"""Its centre, and its right, upper, left and lower edge."""
LEFT_BROW, RIGHT_BROW = (46, 53, 52, 65, 55, 70, 63, 105, 66, 107), (276, 283, 282, 295, 285, 300, 293, 334, 296, 336)
NOSE = (168, 6, 197, 195, 5, 4, 1, 19, 94, 2, 98, 97, 326, 327, 294, 278, 344, 440, 275, 45, 220, 115, 48, 64)
JAW_LINE = (
    *(127, 234, 93, 132, 58, 172, 136, 150, 149, 176, 148, 152),
    *(377, 400, 378, 379, 365, 397, 288, 361, 323, 454, 356),
)
"""Outline of the face below the eyes, from ear to ear: the network places it where the face ends in the image."""
FACE_OUTLINE = (*JAW_LINE, 389, 251, 284, 332, 297, 338, 10, 109, 67, 103, 54, 21, 162)

LIP_GAPS = ((13, 14), (82, 87), (312, 317))
"""Pairs of upper and lower landmarks whose distance is the opening of the mouth."""
LEFT_LID_GAPS = ((159, 145), (158, 153), (160, 144))
RIGHT_LID_GAPS = ((386, 374), (385, 380), (387, 373))
"""Pairs of upper and lower landmarks whose distance is the opening of the eye."""

REGIONS = {
    "lips": LIPS,
    "eyes": (*LEFT_EYE, *RIGHT_EYE),
    "irises": (*LEFT_IRIS, *RIGHT_IRIS),
    "brows": (*LEFT_BROW, *RIGHT_BROW),
    "nose": NOSE,
    "jaw line": JAW_LINE,
}
"""Landmarks of the parts of a face that errors are given for."""
