#include "service/rpc/tls.h"

#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>

#include "service/rpc/call_headers.h"
#include "service/rpc/tls_files.h"

namespace teletact::service {

std::shared_ptr<grpc::ServerCredentials> credentials_of(const ListenOptions& o) {
  if (o.tls_certificate.empty()) return clear_credentials();
  constexpr unsigned kLookS = 1;  // at the copies
  struct Kept {
    explicit Kept(const ListenOptions& options) : files(options) {}
    TlsFiles files;
    std::shared_ptr<grpc::ServerCredentials> credentials;
  };
  const auto kept = std::make_shared<Kept>(o);
  using namespace grpc::experimental;
  TlsServerCredentialsOptions options(std::make_shared<FileWatcherCertificateProvider>(
      kept->files.key(), kept->files.certificate(), kept->files.client_ca(), kLookS));
  options.watch_identity_key_cert_pairs();
  if (!o.tls_client_ca.empty()) {
    options.watch_root_certs();
    options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  }
  kept->credentials = TlsServerCredentials(options);
  return {kept, kept->credentials.get()};
}

}  // namespace teletact::service
