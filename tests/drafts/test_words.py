"""What names of columns say, in many vocabularies."""

import pytest

from steelyard.drafts.words import quantity_of, read_name, words_of


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("/imu/accX_1", ("imu", "acc", "x", "1")),
        ("Seilkraft 12 [N]", ("seilkraft", "12", "n")),
        ("TCP.pos.y", ("tcp", "pos", "y")),
        ("", ()),
    ],
)
def test_words(text, words):
    assert words_of(text) == words


@pytest.mark.parametrize(
    ("column", "words", "unit"),
    [
        ("gyro_x_deg_s", ("gyro", "x"), "deg/s"),
        ("acc_z [m/s^2]", ("acc", "z"), "m/s^2"),
        ("wx", ("w", "x"), None),
        ("F1_kN", ("f", "1"), "kN"),
        ("time_ms", ("time",), "ms"),
        ("mass_g", ("mass", "g"), None),
    ],
)
def test_units_stand_behind_what_can_have_one(column, words, unit):
    name = read_name(column)
    assert (name.words, name.unit) == (words, unit)


@pytest.mark.parametrize(
    ("column", "quantity"),
    [
        ("gyro_x", "angular_velocity"),
        ("angular_velocity.y", "angular_velocity"),
        ("velocity.y", None),
        ("linear_acceleration.z", "specific_force"),
        ("orientation.w", "orientation"),
        ("Drehmoment_x", "torque"),
        ("prism_x", "position"),
        ("magnetometer_x", None),
        ("data_x", ""),
    ],
)
def test_the_last_word_that_says_anything_decides(column, quantity):
    name = read_name(column)
    assert quantity_of(name.template(name.axis)) == quantity


def test_components_of_one_vector_share_a_template():
    templates = {read_name(f"imu.acc_{axis}").template(2) for axis in "xyz"}
    assert templates == {("imu", "acc", "@")}
    assert read_name("f12").numbers == [1]
    assert read_name("pitch_deg").angle == 0
    assert read_name("Zeitstempel").is_time
    assert not read_name("x").is_time
