"""Reports: results come in, pages of HTML go out."""
