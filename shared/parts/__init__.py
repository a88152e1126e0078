"""Part files: the schemas of ring, guide, nail and hexapod files, and the catalogue that the product ships."""
