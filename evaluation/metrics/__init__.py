"""Metrics on images and on embeddings of images.

- `catalogue`: names, directions and sources of all metrics
- `image_records`: all metrics of rendered images alone; `frame_views`: what they read of a frame
- `image_quality`, `against_truth`: PSNR and SSIM, of rendered frames by region; `regions`: image regions of a head
- `lpips`: LPIPS, and its networks
- `photo_consistency`: agreement of neighbouring cameras and of neighbouring orbit frames, by `view_warping`
- `sharpness`: gradient energy over that of a reference
- `avatar_geometry`: metrics of the avatar itself, which the stage `render` takes: `mesh_adherence`, depth, normals,
  silhouette and holes against the mesh, and `exaggeration_gain`
- `clip`: CLIP-I, CLIP-D and CLIP-C, and the CLIP network
- `dino`: DINO similarity, and the DINO network
- `stable_diffusion`: the SD score; `diffusion_model`: the networks of Stable Diffusion
- `identity`: faces compared by dlib's network; `face_alignment`: faces cut out of images
- `embeddings`: records of the metrics of both networks; `embedding_networks`: which frames are embedded, and the
  scores; `frame_sequences`: rendered frames beside the same frames without the edit
- `embedder`, `embedding_cache`: embeddings of images, each computed once; `preprocessing`: images as network input
- `weights`: registry and search of network weights; `downloads`; `checksums`: whether files are intact;
  `device`: where PyTorch runs
"""
