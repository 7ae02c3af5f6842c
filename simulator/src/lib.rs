//! Simulated MAVLink drones with cameras that look into rooms.
//!
//! A drone here knows of Volery what a real one knows: what arrives by UDP, HTTP and WebSocket.
