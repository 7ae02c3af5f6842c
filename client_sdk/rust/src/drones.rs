//! Drones.

use reqwest::Method;
use uuid::Uuid;
use volery_api::{
    AllStopped, CreateLease, CreateRecording, Drone, DroneCamera, DroneCommand, DroneCommandStatus,
    DronePose, DronePoseAnswer, DroneState, FrameAnswer, FrameParams, Lease, PatchDrone, PutDrone,
    PutDroneCamera, Recording,
};

use crate::{Client, ClientError, client::parsed};

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
        parsed(&self.send_once(self.request(Method::POST, &path).json(command)).await?)
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
        parsed(&self.send_once(self.request(Method::POST, &path).json(pose)).await?)
    }

    /// Finds the place of a drone by one frame of its camera, as at the end of a way.
    pub async fn drone_frame(
        &self,
        id: u8,
        params: &FrameParams,
        image: Vec<u8>,
    ) -> Result<FrameAnswer, ClientError> {
        let FrameParams { map_id, age_ms, extend } = params;
        let age_ms = age_ms.unwrap_or(0.0);
        let path =
            format!("/v1/drones/{id}/frames?map_id={map_id}&age_ms={age_ms}&extend={extend}");
        let request = self.request(Method::POST, &path).body(image);
        let request = request.header("Content-Type", "application/octet-stream");
        parsed(&self.send_once(request).await?)
    }

    /// The newest picture of a drone's camera: JPEG or PNG.
    pub async fn newest_frame(&self, id: u8) -> Result<bytes::Bytes, ClientError> {
        let path = format!("/v1/drones/{id}/frame");
        self.send(self.request(Method::GET, &path)).await
    }

    /// Has the camera of a drone pulled, until it is deleted.
    pub async fn put_drone_camera(
        &self,
        id: u8,
        camera: &PutDroneCamera,
    ) -> Result<DroneCamera, ClientError> {
        self.call(Method::PUT, &format!("/v1/drones/{id}/camera"), camera).await
    }

    /// The camera of a drone that is pulled, and how that goes.
    pub async fn drone_camera(&self, id: u8) -> Result<DroneCamera, ClientError> {
        self.get(&format!("/v1/drones/{id}/camera")).await
    }

    /// Pulls the camera of a drone no more.
    pub async fn delete_drone_camera(&self, id: u8) -> Result<(), ClientError> {
        self.delete(&format!("/v1/drones/{id}/camera")).await
    }

    /// Records everything that a drone's link sends and receives, from now on.
    pub async fn start_recording(&self, drone: u8) -> Result<Recording, ClientError> {
        self.call(Method::POST, "/v1/recordings", &CreateRecording { drone }).await
    }

    /// All recordings, the oldest first.
    pub async fn recordings(&self) -> Result<Vec<Recording>, ClientError> {
        self.list("/v1/recordings").await
    }

    /// Ends a recording.
    pub async fn stop_recording(&self, id: Uuid) -> Result<Recording, ClientError> {
        let path = format!("/v1/recordings/{id}/stop");
        parsed(&self.send(self.request(Method::POST, &path)).await?)
    }

    /// The telemetry log of a recording.
    pub async fn recording_file(&self, id: Uuid) -> Result<bytes::Bytes, ClientError> {
        let path = format!("/v1/recordings/{id}");
        self.send(self.request(Method::GET, &path)).await
    }

    /// Ends a recording and deletes its file.
    pub async fn delete_recording(&self, id: Uuid) -> Result<(), ClientError> {
        self.delete(&format!("/v1/recordings/{id}")).await
    }

    /// Stops every drone.
    pub async fn all_stop(&self) -> Result<AllStopped, ClientError> {
        parsed(&self.send(self.request(Method::POST, "/v1/all-stop")).await?)
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
        let path = format!("/v1/leases/{id}/renew");
        parsed(&self.send(self.request(Method::POST, &path)).await?)
    }

    /// Ends a lease: its drones hold.
    pub async fn release_lease(&self, id: Uuid) -> Result<(), ClientError> {
        self.delete(&format!("/v1/leases/{id}")).await
    }
}
