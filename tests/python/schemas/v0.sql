-- A run as the program of commit bea5b8f recorded it: its schema (version 0) as it stood there, a few rows by hand.
PRAGMA user_version=0;
CREATE TABLE run(uid TEXT, time TEXT, protocol TEXT, title TEXT, script TEXT, script_hash TEXT, operator TEXT,
  parameters TEXT, parameter_units TEXT, seed TEXT, versions TEXT, rig TEXT, rig_hash TEXT);
CREATE TABLE stream(id INTEGER PRIMARY KEY, name TEXT UNIQUE, source TEXT, sample_table TEXT);
CREATE TABLE channel(stream INTEGER REFERENCES stream(id), position INTEGER, name TEXT, unit TEXT);
CREATE TABLE event(seq INTEGER PRIMARY KEY, t_ns INTEGER, kind TEXT, text TEXT);
CREATE TABLE figure(name TEXT PRIMARY KEY, value REAL, unit TEXT);
CREATE TABLE picture(seq INTEGER PRIMARY KEY, name TEXT, caption TEXT, file TEXT);
CREATE TABLE result_table(seq INTEGER PRIMARY KEY, title TEXT, header TEXT, rows TEXT);
CREATE TABLE stop(time TEXT, exit_status TEXT, reason TEXT, experiment_time REAL, wall_time REAL, counts TEXT);
CREATE TABLE "sample_servo"(seq INTEGER PRIMARY KEY, t_ns INTEGER NOT NULL, "x" REAL, "u_px" REAL);
INSERT INTO run VALUES('0123456789abcdef0123456789abcdef', '2026-11-21T14:30:05+0100', 'protocols/servo_square.lua', 'Square by servo',
  'return { title = "Square by servo" }', '104b7c9a757b3775dd04431b7a91055cdaff06cf4d99bdb19efba64868f0b75a', 'Ann',
  '{"speed":0.0005,"laps":2,"careful":true}', '{"speed":"mm/s","laps":""}', '7',
  '{"vitreo":"0.1","commit":"bea5b8f"}', '{"file":"scripts/rigs/simulated.lua","text":"return {}"}',
  'e5580c2d99b67425bc48350035dc674f3aaf776be79b9d30054b77d6a080c8cf');
INSERT INTO stream VALUES(0, 'servo', 'top camera through the eye', 'sample_servo');
INSERT INTO channel VALUES(0, 0, 'x', 'm'), (0, 1, 'u_px', '');
INSERT INTO sample_servo VALUES(1, 66666667, 0.001, 700.5), (2, 133333333, NULL, NULL), (3, 200000000, 0.0012, 701.25);
INSERT INTO event VALUES(1, 0, 'note', 'begun'), (2, 200000000, 'alarm', 'low: disk: it is slow');
INSERT INTO figure VALUES('path_error_rms', 0.00012, 'um'), ('share', 0.5, '%');
INSERT INTO result_table VALUES(1, 'Laps', '["lap","error"]', '[["1","0.11 mm"],["2","0.13 mm"]]');
INSERT INTO picture VALUES(1, 'frame_1', 'the first', 'pictures/001_frame_1.png');
INSERT INTO stop VALUES('2026-11-21T14:31:05+0100', 'completed', '', 60.0, 8.5, '{"servo":3}');
