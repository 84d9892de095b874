// How the tests touch a fake service's scene.
#pragma once

#include <string>

#include "client/session/operator_session.h"

namespace teletact::client::test {

inline OperatorSessionOptions session_options(const std::string& address) {
  OperatorSessionOptions options;
  options.address = address;
  options.open.set_scene_id("s");
  options.open.set_period_s(0.002);
  options.open.set_credit(2);
  options.real_time = false;  // not for the threads of a test binary
  return options;
}

}  // namespace teletact::client::test
