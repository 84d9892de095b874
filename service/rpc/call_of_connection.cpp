#include "service/rpc/call_of_connection.h"

#include <fmt/format.h>
#include <grpc/grpc_security.h>
#include <grpc/grpc_security_constants.h>
#include <grpcpp/security/auth_metadata_processor.h>

#include <iterator>
#include <string>
#include <utility>

#include "service/scene/errors.h"

namespace teletact::service {

namespace {

// Each connection has one, and it stands in the same place as long as its context lives.
constexpr const char* kProperty = GRPC_TRANSPORT_SECURITY_TYPE_PROPERTY_NAME;

class CountHeaders final : public grpc::AuthMetadataProcessor {
 public:
  explicit CountHeaders(Connections& connections) : connections_(connections) {}
  bool IsBlocking() const override { return false; }
  grpc::Status Process(const InputMetadata&, grpc::AuthContext* peer, OutputMetadata*,
                       OutputMetadata*) override {
    connections_.call_came(identity_of(*peer));
    return grpc::Status::OK;
  }
  void process(grpc_auth_context* peer) {
    grpc_auth_property_iterator all = grpc_auth_context_find_properties_by_name(peer, kProperty);
    const grpc_auth_property* property = grpc_auth_property_iterator_next(&all);
    connections_.call_came(property ? property->value : nullptr);
  }

 private:
  Connections& connections_;
};

class ClearCredentials final : public grpc::ServerCredentials {
 public:
  ~ClearCredentials() override { grpc_server_credentials_release(credentials_); }
  void SetAuthMetadataProcessor(const std::shared_ptr<grpc::AuthMetadataProcessor>& processor) override {
    grpc_server_credentials_set_auth_metadata_processor(
        credentials_, {process, [](void* kept) { delete static_cast<Kept*>(kept); }, new Kept(processor)});
  }

 private:
  using Kept = std::shared_ptr<grpc::AuthMetadataProcessor>;
  // Without a copy of the headers, which nobody reads.
  static void process(void* kept, grpc_auth_context* peer, const grpc_metadata*, std::size_t,
                      grpc_process_auth_metadata_done_cb done, void* call) {
    static_cast<CountHeaders&>(**static_cast<Kept*>(kept)).process(peer);
    done(call, nullptr, 0, nullptr, 0, GRPC_STATUS_OK, nullptr);
  }
  int AddPortToServer(const std::string& address, grpc_server* server) override {
    return grpc_server_add_http2_port(server, address.c_str(), credentials_);
  }
  grpc_server_credentials* const credentials_ = grpc_insecure_server_credentials_create();
};

}  // namespace

Connections::Identity identity_of(const grpc::AuthContext& peer) {
  const auto values = peer.FindPropertyValues(kProperty);
  return values.empty() ? nullptr : values.front().data();
}

std::shared_ptr<grpc::ServerCredentials> clear_credentials() {
  return std::make_shared<ClearCredentials>();
}

void count_headers(grpc::ServerCredentials& credentials, Connections& connections) {
  credentials.SetAuthMetadataProcessor(std::make_shared<CountHeaders>(connections));
}

namespace {

class CountedCall final : public grpc::experimental::Interceptor {
 public:
  CountedCall(Connections& connections, const grpc::ServerContextBase& context)
      : context_(context), call_(connections, context, true) {}
  void Intercept(grpc::experimental::InterceptorBatchMethods* methods) override {
    using Point = grpc::experimental::InterceptionHookPoints;
    if (methods->QueryInterceptionHookPoint(Point::POST_RECV_CLOSE) && context_.IsCancelled()) call_.waste();
    methods->Proceed();
  }

 private:
  const grpc::ServerContextBase& context_;
  CallOfConnection call_;
};

}  // namespace

void CallOfConnection::vouch() {
  if (!connection_ || connection_->vouched()) return;
  const auto peer = context_.auth_context();
  connections_.vouch(*connection_, identity_of(*peer), peer);
}

// A stream counts itself: its every message would pass here.
grpc::experimental::Interceptor* CountCalls::CreateServerInterceptor(
    grpc::experimental::ServerRpcInfo* call) {
  if (call->type() == grpc::experimental::ServerRpcInfo::Type::BIDI_STREAMING) return nullptr;
  return new CountedCall(connections_, *call->server_context());
}

}  // namespace teletact::service
