// How connections are encrypted, and which clients get one.
#pragma once

#include <grpcpp/security/server_credentials.h>

#include <memory>

#include "service/rpc/address.h"

namespace teletact::service {

// New files in the place of these are taken within two seconds, for connections that are made from then on,
// and while the result lives; those that do not fit are not taken. Throws std::runtime_error, one line with
// the flag, for PEM files that cannot be read or do not fit.
std::shared_ptr<grpc::ServerCredentials> credentials_of(const ListenOptions&);

}  // namespace teletact::service
