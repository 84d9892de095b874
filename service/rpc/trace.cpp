#include "service/rpc/trace.h"

#include <iterator>

#include "service/rpc/status.h"

namespace teletact::service {

std::optional<std::string_view> traceparent_in(const grpc::ServerContextBase& context) {
  const auto [begin, end] = context.client_metadata().equal_range("traceparent");
  if (begin == end || std::next(begin) != end) return std::nullopt;
  return std::string_view(begin->second.data(), begin->second.size());
}

std::string error_of_service(const grpc::Status& status) {
  switch (status.error_code()) {
    case grpc::StatusCode::UNKNOWN:
    case grpc::StatusCode::DEADLINE_EXCEEDED:
    case grpc::StatusCode::UNIMPLEMENTED:
    case grpc::StatusCode::INTERNAL:
    case grpc::StatusCode::UNAVAILABLE:
    case grpc::StatusCode::DATA_LOSS:
      return std::string(name_of(status.error_code())) + ": " + status.error_message();
    default:
      return {};
  }
}

}  // namespace teletact::service
