// The wire types by name; all are generated from openapi.yaml.
import type { components } from './schema';

type Schemas = components['schemas'];

export type Schema<Name extends keyof Schemas> = Schemas[Name];

export type Camera = Schemas['Camera'];
export type CameraPose = Schemas['CameraPose'];
export type CreateJob = Schemas['CreateJob'];
export type Drone = Schemas['Drone'];
export type DroneCommand = Schemas['DroneCommand'];
export type DroneAlert = Schemas['DroneAlert'];
export type DroneCommandStatus = Schemas['DroneCommandStatus'];
export type DroneState = Schemas['DroneState'];
export type FenceBlock = Schemas['FenceBlock'];
export type Flight = Schemas['Flight'];
export type Target = Schemas['Target'];
export type FlightLeg = Schemas['FlightLeg'];
export type Geofence = Schemas['Geofence'];
export type Image = Schemas['Image'];
export type ImageSet = Schemas['ImageSet'];
export type Info = Schemas['Info'];
export type Job = Schemas['Job'];
export type JobEvent = Schemas['JobEvent'];
export type LocalizeAnswer = Schemas['LocalizeAnswer'];
export type MapCameras = Schemas['MapCameras'];
export type MapVersion = Schemas['MapVersion'];
export type Problem = Schemas['Problem'];
export type TrackedFrame = Schemas['TrackedFrame'];
export type UploadReport = Schemas['UploadReport'];
export type UploadResult = Schemas['UploadResult'];
/** A place; `Map` is a word of the language. */
export type PlaceMap = Schemas['Map'];
