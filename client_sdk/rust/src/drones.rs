//! Drones.

use reqwest::Method;
use uuid::Uuid;
use volery_api::{
    AllStopped, CreateLease, Drone, DroneCommand, DroneCommandStatus, DronePose, DronePoseAnswer,
    DroneState, FrameAnswer, Lease, PatchDrone, PutDrone,
};

use crate::{Client, ClientError};

impl Client {
    /// Drones that are registered or were heard.
    pub async fn drones(&self) -> Result<Vec<Drone>, ClientError> {
        self.list("/v1/drones").await
    }

    /// One drone by its MAVLink system id.
    pub async fn drone(&self, id: u8) -> Result<Drone, ClientError> {
        self.get(&format!("/v1/drones/{id}")).await
    }

    /// What a drone says of itself, and what it is told.
    pub async fn drone_state(&self, id: u8) -> Result<DroneState, ClientError> {
        self.get(&format!("/v1/drones/{id}/state")).await
    }

    /// Registers a drone or replaces its settings.
    pub async fn put_drone(&self, id: u8, drone: &PutDrone) -> Result<Drone, ClientError> {
        self.call(Method::PUT, &format!("/v1/drones/{id}"), drone).await
    }

    /// Changes settings of a registered drone; what is absent stays, also its key.
    pub async fn patch_drone(&self, id: u8, change: &PatchDrone) -> Result<Drone, ClientError> {
        self.call(Method::PATCH, &format!("/v1/drones/{id}"), change).await
    }

    /// Commands a drone. It is sent once: a command that is late must not come at all.
    pub async fn command_drone(
        &self,
        id: u8,
        command: &DroneCommand,
    ) -> Result<DroneCommandStatus, ClientError> {
        let path = format!("/v1/drones/{id}/commands");
        Ok(self.send_once(self.request(Method::POST, &path).json(command)).await?.json().await?)
    }

    /// How far a command is.
    pub async fn drone_command(
        &self,
        drone: u8,
        command: u64,
    ) -> Result<DroneCommandStatus, ClientError> {
        self.get(&format!("/v1/drones/{drone}/commands/{command}")).await
    }

    /// Tells where a drone is. It is sent once: an old pose is worth nothing.
    pub async fn drone_pose(
        &self,
        id: u8,
        pose: &DronePose,
    ) -> Result<DronePoseAnswer, ClientError> {
        let path = format!("/v1/drones/{id}/pose");
        Ok(self.send_once(self.request(Method::POST, &path).json(pose)).await?.json().await?)
    }

    /// Takes one frame of a drone's camera, `age_ms` after it was taken.
    pub async fn drone_frame(
        &self,
        id: u8,
        map: Uuid,
        image: Vec<u8>,
        age_ms: f64,
    ) -> Result<FrameAnswer, ClientError> {
        let path = format!("/v1/drones/{id}/frames?map_id={map}&age_ms={age_ms}");
        let request = self.request(Method::POST, &path).body(image);
        let request = request.header("Content-Type", "application/octet-stream");
        Ok(self.send_once(request).await?.json().await?)
    }

    /// Stops every drone.
    pub async fn all_stop(&self) -> Result<AllStopped, ClientError> {
        let make = || self.request(Method::POST, "/v1/all-stop");
        Ok(self.send(make).await?.json().await?)
    }

    /// Takes drones: nobody else commands them while the lease lasts, and they hold when it is over.
    pub async fn lease(&self, drones: &[u8], ttl_ms: u32) -> Result<Lease, ClientError> {
        let request = CreateLease { drones: drones.to_vec(), ttl_ms };
        self.call(Method::POST, "/v1/leases", &request).await
    }

    /// Leases that are not over.
    pub async fn leases(&self) -> Result<Vec<Lease>, ClientError> {
        self.list("/v1/leases").await
    }

    /// Renews a lease.
    pub async fn renew_lease(&self, id: Uuid) -> Result<Lease, ClientError> {
        let make = || self.request(Method::POST, &format!("/v1/leases/{id}/renew"));
        Ok(self.send(make).await?.json().await?)
    }

    /// Ends a lease: its drones hold.
    pub async fn release_lease(&self, id: Uuid) -> Result<(), ClientError> {
        self.delete(&format!("/v1/leases/{id}")).await
    }
}
