//! The ground station: HTTP, WebSocket, store, jobs.
