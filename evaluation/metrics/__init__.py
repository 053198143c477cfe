"""Metrics on images and on embeddings of images.

- `catalogue`: names, directions and sources of all metrics
- `image_quality`: PSNR and SSIM
- `regions`: image regions of a head
- `against_truth`: PSNR, SSIM and LPIPS of rendered frames by region
- `lpips`: LPIPS, and its networks
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
