//! Density control: who grows, who is pruned, and what is done to them.
