-- A run as the program of commit d47b065 recorded it: its schema (version 3) as it stood there, a few rows by hand.
PRAGMA user_version=3;
CREATE TABLE run(uid TEXT, time TEXT, protocol TEXT, title TEXT, script TEXT, script_hash TEXT, operator TEXT,
  parameters TEXT, parameter_units TEXT, seed TEXT, versions TEXT, rig TEXT, rig_hash TEXT,
  devices TEXT, files TEXT);
CREATE TABLE module(name TEXT PRIMARY KEY, file TEXT, hash TEXT, text TEXT);
CREATE TABLE stream(id INTEGER PRIMARY KEY, name TEXT UNIQUE, source TEXT, sample_table TEXT);
CREATE TABLE channel(stream INTEGER REFERENCES stream(id), position INTEGER, name TEXT, unit TEXT);
CREATE TABLE camera(name TEXT PRIMARY KEY, identity TEXT, every INTEGER, frame_period REAL, effective_pixel REAL);
CREATE TABLE frame(seq INTEGER PRIMARY KEY, camera TEXT, number INTEGER, t_ns INTEGER, t_received_ns INTEGER,
  t_device_ns INTEGER, file TEXT, offset INTEGER, bytes INTEGER, width_px INTEGER,
  height_px INTEGER, pixel_type INTEGER, crc32 INTEGER, dropped_before INTEGER);
CREATE TABLE event(seq INTEGER PRIMARY KEY, t_ns INTEGER, kind TEXT, text TEXT);
CREATE TABLE result(name TEXT PRIMARY KEY, value REAL, unit TEXT);
CREATE TABLE plot(seq INTEGER PRIMARY KEY, title TEXT, content TEXT);
CREATE TABLE drawing(seq INTEGER PRIMARY KEY, title TEXT, svg TEXT);
CREATE TABLE picture(seq INTEGER PRIMARY KEY, name TEXT, caption TEXT, file TEXT);
CREATE TABLE result_table(seq INTEGER PRIMARY KEY, title TEXT, header TEXT, rows TEXT);
CREATE TABLE stop(time TEXT, exit_status TEXT, reason TEXT, script_line TEXT, experiment_time REAL, wall_time REAL,
  counts TEXT, dropped TEXT, held REAL);
CREATE TABLE "sample_servo"(seq INTEGER PRIMARY KEY, t_ns INTEGER NOT NULL, "x" REAL, "u_px" REAL);
INSERT INTO run VALUES('0123456789abcdef0123456789abcdef', '2026-11-21T14:30:05+0100', 'protocols/servo_square.lua', 'Square by servo',
  'return { title = "Square by servo" }', '104b7c9a757b3775dd04431b7a91055cdaff06cf4d99bdb19efba64868f0b75a', 'Ann',
  '{"speed":0.0005,"laps":2,"careful":true}', '{"speed":"mm/s","laps":""}', '7',
  '{"vitreo":"0.1","commit":"d47b065"}', '{"file":"scripts/rigs/simulated.lua","text":"return {}"}',
  'e5580c2d99b67425bc48350035dc674f3aaf776be79b9d30054b77d6a080c8cf', '{"top_camera":"simulated camera"}', '{"field.yaml":"00"}');
INSERT INTO stream VALUES(0, 'servo', 'top camera through the eye', 'sample_servo');
INSERT INTO channel VALUES(0, 0, 'x', 'm'), (0, 1, 'u_px', '');
INSERT INTO sample_servo VALUES(1, 66666667, 0.001, 700.5), (2, 133333333, NULL, NULL), (3, 200000000, 0.0012, 701.25);
INSERT INTO event VALUES(1, 0, 'note', 'begun'), (2, 200000000, 'alarm', 'low: disk: it is slow');
INSERT INTO result VALUES('path_error_rms', 0.00012, 'um'), ('share', 0.5, '%');
INSERT INTO result_table VALUES(1, 'Laps', '["lap","error"]', '[["1","0.11 mm"],["2","0.13 mm"]]');
INSERT INTO picture VALUES(1, 'frame_1', 'the first', 'pictures/001_frame_1.png');
INSERT INTO module VALUES('places', 'scripts/places.lua', '00', 'return {}');
INSERT INTO plot VALUES(1, 'A line', '{"title":"A line","x":{"label":"time","unit":"s"},"y":{"label":"way","unit":"m"},"equal_aspect":false,"note":"","series":[{"label":"a","mark":"line","x":[0,1],"y":[0,0.001]}]}');
INSERT INTO camera VALUES('top_camera', 'simulated camera', 2, 0.0666666667, 1.43e-05);
INSERT INTO frame VALUES(1, 'top_camera', 1, 66666667, 146666667, NULL, 'frames/top_camera/top_camera_NDTiffStack.tif', 210, 4, 2, 2, 0, 3057449933, 0);
INSERT INTO stop VALUES('2026-11-21T14:31:05+0100', 'completed', '', '', 60.0, 8.5, '{"servo":3}', '{"top_camera":0}', 0.25);
