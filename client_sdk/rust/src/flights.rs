//! Group flights, fences, beacons.

use reqwest::Method;
use uuid::Uuid;
use volery_api::{
    BeaconEstimate, BeaconEstimateRequest, CreateFlight, CreateTarget, Flight, Geofence, Target,
};

use crate::{Client, ClientError, client::parsed};

impl Client {
    /// Plans a flight and checks the plan.
    pub async fn create_flight(&self, flight: &CreateFlight) -> Result<Flight, ClientError> {
        let request = self.request(Method::POST, "/v1/flights").json(flight);
        parsed(&self.send_once(request).await?)
    }

    /// Plans the way of a drone to a place, and flies it there unless it is a dry run.
    pub async fn fly_to(&self, drone: u8, target: &CreateTarget) -> Result<Target, ClientError> {
        let path = format!("/v1/drones/{drone}/target");
        let request = self.request(Method::POST, &path).json(target);
        parsed(&self.send_once(request).await?)
    }

    /// All flights since the server started.
    pub async fn flights(&self) -> Result<Vec<Flight>, ClientError> {
        self.get("/v1/flights").await
    }

    /// A flight: its plan, its state, what happened.
    pub async fn flight(&self, id: Uuid) -> Result<Flight, ClientError> {
        self.get(&format!("/v1/flights/{id}")).await
    }

    /// Takes off and flies when all are at their starts.
    pub async fn start_flight(&self, id: Uuid) -> Result<Flight, ClientError> {
        self.wish(id, "start").await
    }

    /// Everybody waits in the air.
    pub async fn pause_flight(&self, id: Uuid) -> Result<Flight, ClientError> {
        self.wish(id, "pause").await
    }

    /// Goes on after a pause.
    pub async fn resume_flight(&self, id: Uuid) -> Result<Flight, ClientError> {
        self.wish(id, "resume").await
    }

    /// Everybody lands.
    pub async fn abort_flight(&self, id: Uuid) -> Result<Flight, ClientError> {
        self.wish(id, "abort").await
    }

    async fn wish(&self, id: Uuid, wish: &str) -> Result<Flight, ClientError> {
        let request = self.request(Method::POST, &format!("/v1/flights/{id}/{wish}"));
        parsed(&self.send_once(request).await?)
    }

    /// The fences of all maps that have one.
    pub async fn geofences(&self) -> Result<Vec<Geofence>, ClientError> {
        self.get("/v1/geofences").await
    }

    /// Takes the fence of a map away.
    pub async fn delete_geofence(&self, map: Uuid) -> Result<(), ClientError> {
        self.delete(&format!("/v1/geofences/{map}")).await
    }

    /// Sets the fence of a map.
    pub async fn put_geofence(&self, fence: &Geofence) -> Result<Geofence, ClientError> {
        self.call(Method::PUT, "/v1/geofences", fence).await
    }

    /// A position by beacons.
    pub async fn beacon_estimate(
        &self,
        readings: &BeaconEstimateRequest,
    ) -> Result<BeaconEstimate, ClientError> {
        self.call(Method::POST, "/v1/beacons/estimate", readings).await
    }
}
