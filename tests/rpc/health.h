// What a running server says of its health.
#pragma once

#include <grpcpp/impl/codegen/client_unary_call.h>
#include <grpcpp/support/byte_buffer.h>

#include <string>
#include <vector>

#include "tests/rpc/running_server.h"

namespace teletact::service {

constexpr int kServing = 1, kNotServing = 2;
constexpr const char* kElastography = "teletact.v1.Elastography";

// grpc.health.v1.Health/Check by hand: HealthCheckRequest{service = 1}, HealthCheckResponse{status = 1}.
template <class Running>
int health_of(const Running& server, const std::string& service) {
  std::string request;
  if (!service.empty()) request = std::string("\x0a") + static_cast<char>(service.size()) + service;
  grpc::ClientContext context;
  set_deadline(context);
  grpc::ByteBuffer out;
  grpc::Slice slice(request);
  grpc::ByteBuffer in(&slice, 1);
  grpc::internal::RpcMethod method("/grpc.health.v1.Health/Check", grpc::internal::RpcMethod::NORMAL_RPC);
  const auto channel = server.channel();
  const grpc::Status status = grpc::internal::BlockingUnaryCall(channel.get(), method, &context, in, &out);
  if (!status.ok()) return -static_cast<int>(status.error_code());
  std::vector<grpc::Slice> slices;
  out.Dump(&slices);
  std::string bytes;
  for (const auto& s : slices) bytes.append(reinterpret_cast<const char*>(s.begin()), s.size());
  return bytes.size() >= 2 ? bytes[1] : 0;
}

}  // namespace teletact::service
