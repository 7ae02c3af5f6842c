//! Truths of bundle adjustment on rings of cameras around a cloud of points.

mod priors;
mod refusals;
mod ring;
mod truths;
