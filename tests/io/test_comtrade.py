"""Records in COMTRADE as a reader of others sees them."""

import numpy as np
import pytest

import gridfold as gf
from gridfold.io.comtrade import Channel, write_comtrade

comtrade = pytest.importorskip("comtrade")


def written(tmp_path, times, channels, **options):
    path = tmp_path / "run.cfg"
    write_comtrade(path, "grid", "gridfold", np.asarray(times, float), channels, 60.0, **options)
    with path.open("rb") as stream:
        assert stream.read().endswith(b"\r\n")
    return read(path)


def read(path):
    record = comtrade.Comtrade(use_double_precision=True)
    record.load(str(path), str(path.with_suffix(".dat")))
    return record


def test_curves_come_back_to_a_part_in_200_000_of_their_range(tmp_path):
    times = np.arange(501) * 0.01
    flow, speed = 137.2 + 50 * np.sin(7 * times), 1 + 1e-6 * times
    still = np.full(501, 0.0)
    channels = [
        Channel("p_mw:1-2", "MW", flow),
        Channel("s", "pu", speed),
        Channel("z", "pu", still),
    ]
    record = written(tmp_path, times, channels, trigger=1.25)
    assert record.analog_channel_ids == ["p_mw:1-2", "s", "z"]
    assert [channel.uu for channel in record.cfg.analog_channels] == ["MW", "pu", "pu"]
    assert (record.station_name, record.rev_year, record.frequency) == ("grid", "1999", 60.0)
    assert (record.total_samples, record.cfg.sample_rates) == (501, [[100.0, 501]])
    assert record.trigger_time == pytest.approx(1.25)
    np.testing.assert_allclose(record.time, times, atol=1e-9)
    for found, curve in zip(record.analog, (flow, speed, still), strict=True):
        np.testing.assert_allclose(found, curve, rtol=0, atol=max(np.ptp(curve) / 2e5, 1e-15))


def test_missing_samples_are_marked_and_uneven_steps_have_their_times(tmp_path):
    times = [0.0, 0.01, 0.035, 0.1]
    written(tmp_path, times, [Channel("a", "pu", np.array([1.0, np.nan, 3.0, 2.0]))])
    rows = (tmp_path / "run.dat").read_text().split()
    assert rows == ["1,0,-99998", "2,10000,99999", "3,35000,99998", "4,100000,0"]
    lines = (tmp_path / "run.cfg").read_text().splitlines()
    assert lines[4:6] == ["0", "0,4"]


def test_names_are_ascii_without_commas_and_long_times_fit_ten_digits(tmp_path):
    name = "interface_mw:area:1 to area:2, Süd" + 60 * "x"
    record = written(tmp_path, [0.0, 5e4], [Channel(name, "MW", np.array([0.0, 1.0]))])
    (channel,) = record.analog_channel_ids
    assert channel.startswith("interface_mw:area:1 to area:2; S?d")
    assert len(channel) == 64
    np.testing.assert_allclose(record.time, [0.0, 5e4])


def test_a_run_is_written_with_what_is_watched(npcc, tmp_path):
    run = gf.simulate(npcc, [gf.BusFault(3, 0.1, 0.1)], 0.5, gf.RungeKutta4(0.01))
    run.to_comtrade(tmp_path / "run.cfg", "flow 3-2, voltage 3, speed 78, frequency 5")
    record = read(tmp_path / "run.cfg")
    frame = run.frame("flow 3-2, voltage 3, speed 78, frequency 5")
    assert record.analog_channel_ids == list(frame.columns[1:])
    units = [channel.uu for channel in record.cfg.analog_channels]
    assert units == ["MW", "Mvar", "pu", "pu", "Hz"]
    for found, name in zip(record.analog, frame.columns[1:], strict=True):
        np.testing.assert_allclose(
            found, frame[name], rtol=0, atol=np.ptp(frame[name]) / 2e5 + 1e-12
        )
    with pytest.raises(gf.OptionError, match=r"ends in \.cfg, not '\.dat'"):
        run.to_comtrade(tmp_path / "run.dat")
