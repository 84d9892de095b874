// Where the service listens, checked before gRPC sees it: gRPC would share a busy TCP port silently and steal
// a live Unix socket.
#pragma once

#include <grpcpp/security/server_credentials.h>

#include <filesystem>
#include <memory>
#include <string>

namespace teletact::service {

struct ListenOptions {
  std::string listen = "127.0.0.1:50051";  // HOST:PORT, [IPV6]:PORT or unix:/path
  bool allow_insecure_remote = false;
  std::filesystem::path tls_certificate, tls_key;  // PEM; both or none
};

// Checks the address and removes a Unix socket that nobody serves any more. Throws std::runtime_error, one
// line: malformed, path too long, in use, not a socket, remote without TLS. Returns the address for gRPC.
std::string prepare_address(const ListenOptions&);
// Throws std::runtime_error when a PEM file cannot be read.
std::shared_ptr<grpc::ServerCredentials> credentials_of(const ListenOptions&);

}  // namespace teletact::service
