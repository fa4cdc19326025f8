"""Runs started, followed, answered, paused, resumed and stopped by the package.
SPDX-License-Identifier: Apache-2.0
"""

import os
import threading
import time
import unittest

import support
import vitreo


def start(parameters, **options):
    return vitreo.start(support.asking(), parameters, out=support.PLACE / "live", cwd=support.PLACE, **options)


class Live(unittest.TestCase):
    def begun(self, **options):
        live = start({"laps": 1000000}, **options)
        self.addCleanup(lambda: live.process.poll() is None and live.process.kill())
        return live

    def test_a_run_is_answered_paused_resumed_and_stopped(self):
        live = self.begun(real_time=True)
        self.assertIn(live.name, vitreo.going_on())
        self.assertEqual(vitreo.attach(live.name[:-1]).folder, live.folder.resolve())
        question = live.wait_until(lambda status: "question" in status, 60)["question"]
        self.assertEqual((question["name"], live.question["text"]), ("width", question["text"]))
        self.assertEqual(live.record.outcome, "running")
        with self.assertRaisesRegex(vitreo.RunError, f"{live.name}: width: wants 0 to 10 mm; got 12mm"):
            live.answer("12mm")
        live.answer("3mm", by="Ann")
        live.wait_until(lambda status: "lap" in status["doing"] or status["progress"] > 0, 60)
        live.pause()
        paused = live.wait_until(lambda status: status["phase"] == "paused", 60)
        self.assertIn("resume", paused["waiting_for"])
        live.resume()
        live.wait_until(lambda status: status["phase"] == "running", 60)
        with self.assertRaisesRegex(vitreo.RunError, "no alarm stands"):
            live.acknowledge()
        with self.assertRaisesRegex(vitreo.RunError, "'jump' is not understood"):
            live.request("jump")
        live.stop(by="Ann")
        record = live.wait(120)
        self.assertEqual((record.outcome, record.end["reason"]), ("stopped", "stopped by Ann"))
        self.assertIn("3mm (Ann)", list(record.events.text))
        self.assertEqual(record.results["width"], 3e-3)
        self.assertNotIn(live.name, vitreo.going_on())
        with self.assertRaisesRegex(vitreo.RunError, f"{live.name}: is over"):
            live.status()

    def test_a_stage_is_moved_while_the_run_goes_on(self):
        live = self.begun(real_time=True, rig="calibration")
        live.wait_until(lambda status: "instruments" in status, 60)
        with self.assertRaisesRegex(vitreo.RunError, "'stage w' is none of those that can be adjusted"):
            live.adjust("stage w", 1e-3)
        live.adjust("stage z", 2e-3, by="Ann")

        def there(status):
            return any(one["name"] == "stage z" and one["value"] is not None and abs(one["value"] - 2e-3) < 1e-5
                       for one in status["instruments"])

        live.wait_until(there, 60)
        live.stop(by="Ann")
        events = live.wait(120).events
        self.assertIn("stage z to 2 mm, by Ann", list(events.text))

    def test_a_stream_is_followed_sample_by_sample_to_the_end(self):
        live = self.begun(answers={"width": "1mm"})
        parts = []
        for rows in live.follow_stream("laps", every=0.05):
            parts.append(rows)
            if len(parts) == 3:
                live.stop()
        followed = [lap for rows in parts for lap in rows.lap]
        record = live.wait(120)
        self.assertEqual(followed, list(record.laps.lap))
        self.assertEqual(followed, list(range(1, len(followed) + 1)))
        self.assertGreaterEqual(len(parts), 3)
        self.assertEqual(record.verify(), [], "reading it meanwhile left nothing behind")

    def test_another_program_follows_each_change_to_the_end(self):
        live = self.begun()
        seen = []
        follower = threading.Thread(target=lambda: seen.extend(vitreo.attach(live.name).follow()))
        live.wait_until(lambda status: "question" in status, 60)
        follower.start()
        while not seen and follower.is_alive():
            time.sleep(0.01)
        live.answer("2mm")
        live.wait_until(lambda status: status["progress"] > 0, 60)
        attached = vitreo.attach(live.name)
        with self.assertRaisesRegex(vitreo.RunError, f"{live.name}: still goes on after 0.1 s"):
            attached.wait(0.1)
        followed = iter(attached.follow_stream("laps", every=0.05))
        laps = list(next(followed).lap)
        live.abort()
        self.assertEqual(attached.wait(120).outcome, "aborted")
        self.assertEqual(laps + [lap for rows in followed for lap in rows.lap], list(attached.record.laps.lap))
        self.assertEqual(live.wait(120).outcome, "aborted")
        follower.join(60)
        self.assertFalse(follower.is_alive())
        self.assertIn("question", seen[0])
        self.assertTrue(any("question" not in status for status in seen))
        self.assertTrue(all(a != b for a, b in zip(seen, seen[1:])))

    def test_a_killed_run_is_lost_and_over(self):
        live = self.begun(answers={"width": "1mm"})
        next(live.follow_stream("laps", every=0.05))
        live.process.kill()
        record = live.wait(60)
        self.assertEqual(record.outcome, "lost")
        self.assertGreater(len(record.laps), 0, "what was committed before the kill")
        self.assertIsNone(record.end)
        self.assertNotIn(live.name, vitreo.going_on(), "its socket is left behind, without a listener")
        self.assertEqual(vitreo.runs(support.PLACE / "live").outcome[record.name], "lost")
        support.program("recover", record.folder, json_of=False)
        self.assertEqual(vitreo.runs(support.PLACE / "live").reason[record.name], record.end["reason"])
        self.assertEqual(record.verify(), [])

    def test_what_cannot_begin_says_why(self):
        for words, parameters, message in (
                ("no_such_protocol", {}, "exit code 2: there is no protocol 'no_such_protocol'"),
                (support.asking(), {"speed": "0.5"}, "exit code 2: speed: wants a speed"),
                (support.asking(), {"speed": 5.0}, "exit code 2: speed: .* got 5"),
                (support.asking(), {"sped": 1e-3}, "exit code 2: .*sped")):
            with self.assertRaisesRegex(vitreo.RunError, message):
                vitreo.start(words, parameters, out=support.PLACE / "never", cwd=support.PLACE)
        self.assertEqual(list(support.PLACE.glob("never/*")), [])
        with self.assertRaisesRegex(TypeError, "laps: wants a text as it is typed, a number"):
            start({"laps": [1, 2]})
        with self.assertRaisesRegex(vitreo.RunError, "/no/vitreo: cannot be started"):
            vitreo.start("hold", program="/no/vitreo")
        with self.assertRaisesRegex(vitreo.RunError, "no run that is going on begins with '1999'"):
            vitreo.attach("1999")

    def test_a_folder_of_sockets_that_others_can_enter_is_refused(self):
        folder = support.PLACE / "runtime" / "vitreo"
        folder.mkdir(mode=0o700, exist_ok=True)
        folder.chmod(0o755)
        self.addCleanup(folder.chmod, 0o700)
        with self.assertRaisesRegex(vitreo.RunError, f"{folder}: is not a folder that only this user can enter"):
            vitreo.going_on()
        self.assertTrue(os.path.isdir(folder))


if __name__ == "__main__":
    unittest.main()
