"""What carigs needs of the machine and its operating system, and no method does.

- `files`: files and folders that exist as a whole, or not at all
- `cache_folders`: where caches lie
- `processes`: names of processes, also of other hosts
- `run_process`: a process that ends when its parent does
- `fork_server`: jobs as forks of one process that has imported the libraries
"""
