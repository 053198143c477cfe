"""The settings of a study: composed by Hydra from `conf/`, frozen as YAML for each stage, loaded as dataclasses.

Hydra finds groups in the project's `conf/` and in a folder `conf/` of the current directory, for subjects, variants and
studies of your own.

- `compose`, `compose_study`, `compose_variant`: settings from overrides
- `snakemake_config`, `join_overrides`, `split_overrides`: overrides to the command line of Snakemake and back
- `settings_text`, `yaml_text`, `load_settings`: a section as YAML and back
- `rendered_levels`, `left_out_levels`, `target_levels`, `target_maker`: what paths of the workflow depend on
- `split_sweep`, `read_sweep`, `study_table`: the combinations of a sweep, and the studies of a run
- `project_root`, `CONF`, `GROUPS`, `known`: files of the configuration
"""

from carigs.config.composition import compose, compose_study
from carigs.config.folders import CONF, GROUPS, known, project_root
from carigs.config.frozen import load_settings, settings_text, yaml_text
from carigs.config.levels import left_out_levels, rendered_levels, target_levels
from carigs.config.overrides import join_overrides, snakemake_config, split_overrides
from carigs.config.sweep import SweepGrid, read_sweep, split_sweep, study_table
from carigs.config.variants import compose_variant, target_maker

__all__ = [
    "CONF",
    "GROUPS",
    "SweepGrid",
    "compose",
    "compose_study",
    "compose_variant",
    "join_overrides",
    "known",
    "left_out_levels",
    "load_settings",
    "project_root",
    "read_sweep",
    "rendered_levels",
    "settings_text",
    "snakemake_config",
    "split_overrides",
    "split_sweep",
    "study_table",
    "target_levels",
    "target_maker",
    "yaml_text",
]
