//! The CPU backend's own tests. Only `allocations` needs a process of its own.

mod compact;
mod scene3d;
