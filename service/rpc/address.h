// Where the service listens. gRPC would share a busy TCP port silently and steal a live Unix socket.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "common/file_descriptor.h"

namespace teletact::service {

struct ListenOptions {
  std::string listen = "127.0.0.1:50051";  // HOST:PORT, [IPV6]:PORT or unix:/path
  bool allow_insecure_remote = false;
  std::filesystem::path tls_certificate, tls_key;  // PEM; both or none
  std::filesystem::path tls_client_ca;             // PEM; who shows no certificate of it is not let in
  std::filesystem::path access;                    // who may do what; empty: whoever can connect may do all
};

struct Listening {
  std::string address;                  // for gRPC and its clients: with the port that was chosen for 0
  std::shared_ptr<void> held;           // as Address has it
  std::vector<FileDescriptor> sockets;  // of TCP: they listen
};
// Checks the address, removes a Unix socket that nobody serves any more, and listens on TCP. Throws
// std::runtime_error, one line: malformed, path too long, in use, not a socket, remote without TLS, half of
// what TLS takes.
Listening prepare_address(const ListenOptions&);

struct Address {
  std::string socket;  // a Unix socket's path; empty: host and port
  std::string host;
  std::uint16_t port = 0;
  // Of a Unix socket that was prepared, until it is listened on no more: of processes that start at the same
  // moment one has it. Locks the file PATH.lock, which stays.
  std::shared_ptr<void> held;
};
// What is written, whether or not it can be listened on. Throws std::runtime_error, one line that names
// `flag`.
Address parse_address(const char* flag, const std::string& text);
// As prepare_address, for what only this machine may reach, and nothing encrypts: 127.0.0.1:PORT, [::1]:PORT
// or unix:/path, given by `flag`.
Address prepare_local_address(const char* flag, const std::string& address);

}  // namespace teletact::service
