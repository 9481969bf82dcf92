"""Reports: tables, pictures, plots and pages, written to a folder that replaces the old one."""
