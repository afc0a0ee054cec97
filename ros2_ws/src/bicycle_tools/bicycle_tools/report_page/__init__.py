"""A bag as a page: what `report.sh` draws and writes."""
