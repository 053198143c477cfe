"""Readers of files from outside: one module per kind of file, each with limits and one type of error.

Nothing else in the project opens such a file. A reader checks what a file claims before anything is allocated, runs no
code of the file, and raises `InputError` with the file and the field for whatever is wrong.

- `file_names`: which files a dataset and a head model consist of
- `folders`: the files of a folder, without those that systems leave behind
- `limits`: what is checked before a file is opened, and limits on sizes
- `npz`: NumPy's .npy and .npz
- `json_files`: JSON
- `yaml_files`: YAML files of settings
- `pickles`, `pickled_objects`: pickled dictionaries of arrays, such as FLAME's
- `images`: PNG, JPEG and AVIF
- `archives`: .zip, member by member
- `text`: the encoding and the lines of text in all files
- `mesh_files`: OBJ, PLY, STL, OFF and glTF
- `colmap`: COLMAP's sparse models
- `weights`: network weights in .safetensors and PyTorch's files
- `arrays`: the type, shape and range of an array
- `formats`: the formats that carigs itself writes, and their versions
"""
