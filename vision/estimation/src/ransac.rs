//! Random samples and their scoring, independent of the model.
