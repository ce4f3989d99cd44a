# SPDX-License-Identifier: Apache-2.0
"""tools/bench/driver_pointers.py: which pointers it finds, and where they go.

  test_driver_pointers.py INTERPOSER DRIVER POINTER_KEEPER
"""
import ctypes
import os
import pathlib
import subprocess
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools/bench"))
import driver_pointers  # noqa: E402

IN_CHILD = "TEST_DRIVER_POINTERS"


class WithUrgenGo(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.keeper = ctypes.CDLL(KEEPER)
        cls.keeper.where_launches_go.restype = ctypes.c_char_p
        assert cls.keeper.keep_pointers()
        cls.version = cls.keeper.ask_version()  # loads the driver

    def goes_to(self):
        return os.path.realpath(self.keeper.where_launches_go().decode())

    def test_those_of_the_library_go_past_urgengo_and_back(self):
        pointers = driver_pointers.DriverPointers(DRIVER)
        self.assertGreater(len(pointers.driver_of), 300)
        self.assertEqual(len(pointers.where), 2)
        self.assertGreater(self.version, 0)
        for _ in range(2):
            self.assertEqual(self.goes_to(), INTERPOSER)
            self.assertEqual(pointers.go(directly=True), 2)
            self.assertEqual(self.goes_to(), DRIVER)
            self.assertEqual(self.keeper.ask_version(), self.version)
            self.assertEqual(pointers.go(directly=False), 2)
        self.assertEqual(self.goes_to(), INTERPOSER)

    def test_what_has_changed_since_is_left_alone(self):
        pointers = driver_pointers.DriverPointers(DRIVER)
        place = next(place for place, ours in pointers.where.items())
        word = ctypes.c_uint64.from_address(place)
        ours, word.value = word.value, 42
        self.assertEqual(pointers.go(directly=True), 1)
        self.assertEqual(word.value, 42)
        self.assertEqual(pointers.go(directly=False), 1)
        self.assertEqual(word.value, 42)
        word.value = ours


class WithoutUrgenGo(unittest.TestCase):
    def test_it_says_what_is_missing(self):
        with self.assertRaisesRegex(driver_pointers.NotHere, r"found UrgenGo as \[\]"):
            driver_pointers.DriverPointers()


def main():
    if os.environ.get(IN_CHILD):
        del WithoutUrgenGo.test_it_says_what_is_missing
        unittest.main(argv=sys.argv[:1])
    command = [sys.executable] + sys.argv
    child = {**os.environ, IN_CHILD: "1", "LD_PRELOAD": INTERPOSER,
             "LD_LIBRARY_PATH": os.path.dirname(DRIVER)}
    if subprocess.run(command, env=child).returncode != 0:
        sys.exit(1)
    del WithUrgenGo.setUpClass
    unittest.main(argv=sys.argv[:1], defaultTest="WithoutUrgenGo")


if __name__ == "__main__":
    INTERPOSER, DRIVER, KEEPER = (os.path.realpath(file) for file in sys.argv[1:4])
    main()
