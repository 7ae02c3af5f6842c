//! A folder of photos to a folder with a map, stage by stage, resumable.
