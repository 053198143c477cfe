"""Options that subcommands share."""
