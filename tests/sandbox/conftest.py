"""What stands in inside/ runs in the kernel that the tests start, not here."""

collect_ignore = ["inside"]
