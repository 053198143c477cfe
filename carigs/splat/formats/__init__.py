"""Avatars for other programs: what is read from them, and what is written for them.

- `imported_avatar`: an avatar from a .ply file of GaussianAvatars or SurFhead, head parameters and a head model
- `flame_param`: the head parameters of all timesteps in one file (`flame_param.npz`)
- `world_splats`: surfels in world coordinates at one timestep and level
- `splat_files`: world-space splats as .ply (3DGS, 2DGS) and .splat
- `gltf`, `gltf_splats`: glTF documents; splats by KHR_gaussian_splatting
- `head_meshes`: the mesh of a level as .obj, .ply and .glb, and the gamma path as morph targets

.ply files with triangle-local surfels are in `carigs.splat.surfels.ply`. Modules are imported directly.
"""
