// What an operator of machines sees of the service, over HTTP: /metrics, /livez, /readyz, /version.
#pragma once

#include <memory>
#include <string>

#include "service/operation/http_listener.h"
#include "service/rpc/core.h"

namespace teletact::service {

// Everything that is counted, in Prometheus's text format.
std::string metrics_text(Core&);

// Answers there. As HttpListener; `core` must outlive it.
std::unique_ptr<HttpListener> listen_for_admin(const std::string& address, Core& core);

}  // namespace teletact::service
