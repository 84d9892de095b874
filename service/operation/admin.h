// What an operator of machines sees of the service, over HTTP: /metrics, /livez, /readyz, /version.
#pragma once

#include <string>

#include "service/operation/http_listener.h"
#include "service/rpc/core.h"

namespace teletact::service {

// Everything that is counted, in Prometheus's text format.
std::string metrics_text(Core&);

class Admin {
 public:
  // As HttpListener. `core` must outlive it.
  Admin(const std::string& address, Core& core);
  const std::string& address() const { return listener_.address(); }

 private:
  HttpListener listener_;
};

}  // namespace teletact::service
