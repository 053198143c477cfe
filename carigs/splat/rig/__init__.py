"""The rig: canonical frames of the triangles, their motion, and Jacobian blend skinning of the surfels.

- `rig`: `Rig`, `build_rig`, `face_motion`: frames of the canonical mesh; Jacobian and polar decomposition per triangle
- `face_motion`: `FaceMotion`, the motion of every triangle as records
- `head_sequence`: `HeadSequence`, `head_sequence`: posed meshes and motions at any timestep and level
- `skinning`: `jacobian_blend_skinning`, surfels to world coordinates (paper equation 6); loops: `skinning_simd`
- `jacobian_blend`, `jacobian_blend_backward`: its formulas; `skinning_arguments`: the arguments of its kernels
- `joint_chain`, `linear_blend`, `mesh_gradient`: joints, posed vertices and motion with their gradients, for tracking
  refinement
"""
