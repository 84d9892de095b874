// A device that no longer takes work, for tests: while it is set every launch fails, on every device.
#pragma once

namespace teletact::service {

void fail_launches(bool fail);

}  // namespace teletact::service
