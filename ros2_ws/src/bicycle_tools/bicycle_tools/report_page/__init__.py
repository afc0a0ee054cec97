"""Report of a bag as a page, for `report.sh`."""
