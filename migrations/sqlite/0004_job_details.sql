-- What the user of the map of a job should know, JSON.
ALTER TABLE jobs ADD COLUMN warnings TEXT NOT NULL DEFAULT '[]';

-- The first stage that the next run does anew.
ALTER TABLE jobs ADD COLUMN from_stage TEXT;
