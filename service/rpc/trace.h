// What gRPC's calls say to traces.
#pragma once

#include <grpcpp/server_context.h>

#include <optional>
#include <string>
#include <string_view>

#include "service/trace/current_trace.h"
#include "service/trace/spans.h"
#include "service/trace/trace_context.h"

namespace teletact::service {

// What the caller says in the metadata "traceparent"; none of one that says it twice. Valid as long as the
// context.
std::optional<std::string_view> traceparent_in(const grpc::ServerContextBase&);

// Why the service, not its caller, made the call fail, as OpenTelemetry's conventions for gRPC servers divide
// them; empty where it did not.
std::string error_of_service(const grpc::Status&);

}  // namespace teletact::service
