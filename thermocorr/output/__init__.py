"""What people and programs get: pictures, pages, files."""
