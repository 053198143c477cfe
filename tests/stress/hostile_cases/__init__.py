"""Cases of hostile and damaged files.

- `case`: a file for a reader, and what is right for it
- `pickles`, `arrays`, `json_files`, `images`, `meshes`, `settings`: cases by kind of file
- `every_reader`: files of other formats, and random damage
- `cases`: all of them
"""
