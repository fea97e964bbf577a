//! The sensor field: arrivals, queues and the slot clock.
