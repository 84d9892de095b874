"""A touch goes on after its service was killed and started again at the same address."""

import threading
import time

import numpy as np
import pytest

import teletact


def test_a_touch_outlives_its_service(kept):
    process, service = kept
    with service.touch("kept", session_id="steady", laws=True, resume_s=300) as touch:
        before, instance = touch.at([0.04, 0.002]), touch.opened.instance
        law = touch.law(wait_s=30)
        again = threading.Thread(target=lambda: (time.sleep(0.3), process.start()))
        process.wait_for_state_of("kept")
        process.kill()
        again.start()
        after = touch.at([0.04, 0.002], timeout_s=300)
        again.join()
        assert touch.streams >= 2 and touch.opened.instance != instance
        assert touch.session_id == "steady" and 'session="steady"' in process.log()
        np.testing.assert_allclose(after.force_n, before.force_n, rtol=1e-6, atol=1e-9)
        relearnt = touch.law(wait_s=30)
        poses = [[0.041, 0.0017]]
        np.testing.assert_allclose(relearnt(poses).force_n, law(poses).force_n, rtol=1e-3, atol=1e-6)
    # Calls that may be repeated go over the new process, too.
    assert service.scene("kept").scene_id == "kept"
    touch = service.touch("kept", resume_s=0.5)
    process.kill()
    with pytest.raises(teletact.Unavailable, match="start one with"):
        touch.at([0.03, 0.002], timeout_s=60)
    touch.close()
