"""Reports: tables, pictures, plots and pages, written to a folder that is swapped in whole."""
