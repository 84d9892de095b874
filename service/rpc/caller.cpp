#include "service/rpc/caller.h"

#include <grpc/grpc_security_constants.h>
#include <grpcpp/security/auth_context.h>

#include <iterator>
#include <string_view>

#include "service/access/certificates.h"

namespace teletact::service {

namespace {

std::string_view view(const grpc::string_ref& text) {
  return {text.data(), text.size()};
}

Digest token_in(std::string_view header) {
  constexpr std::string_view kBearer = "Bearer ";
  if (!header.starts_with(kBearer) || header.size() == kBearer.size())
    throw AccessRefused(AccessRefused::Why::kUnknown,
                        "authorization: give 'Bearer TOKEN', as --token-file does");
  return digest_of(header.substr(kBearer.size()));
}

}  // namespace

Proof proof_in(const grpc::ServerContextBase& context) {
  Proof proof;
  const auto [first, last] = context.client_metadata().equal_range("authorization");
  if (first != last) {
    if (std::next(first) != last)  // whoever stands between may have looked at the other one
      throw AccessRefused(AccessRefused::Why::kUnknown, "authorization: it was sent twice; send it once");
    proof.token = token_in(view(first->second));
  }
  const auto peer = context.auth_context();
  if (proof.token || !peer || !peer->IsPeerAuthenticated()) return proof;
  for (const char* property : {GRPC_X509_CN_PROPERTY_NAME, GRPC_X509_SAN_PROPERTY_NAME})
    for (const auto& name : peer->FindPropertyValues(property))
      proof.certificate_names.emplace_back(view(name));
  for (const auto& pem : peer->FindPropertyValues(GRPC_X509_PEM_CERT_PROPERTY_NAME))
    proof.certificate_ends = end_of(std::string(view(pem)));
  return proof;
}

void Caller::begin(const grpc::ServerContextBase& context) {
  if (!access_) return;
  proof_ = proof_in(context);
  const auto table = access_->table();
  name_ = table->known(proof_, access_->now()).name;
}

void Caller::require(const Wanted& wanted) {
  if (!access_) return;
  const auto table = access_->table();
  AccessTable::require(table->known(proof_, access_->now()), wanted);
  const std::lock_guard lock(mutex_);
  wanted_.push_back(wanted);
}

void Caller::look(Clock::time_point now) {
  if (!access_ || (now < next_ && access_->version() == seen_)) return;
  next_ = now + kAgain;
  seen_ = access_->version();  // before the table: one that comes meanwhile is asked at the next look
  const auto table = access_->table();
  const Principal& principal = table->known(proof_, access_->now());
  const std::lock_guard lock(mutex_);
  for (const Wanted& wanted : wanted_) AccessTable::require(principal, wanted);
}

bool Caller::may(const Wanted& wanted) const {
  if (!access_) return true;
  try {
    const auto table = access_->table();
    return AccessTable::may(table->known(proof_, access_->now()), wanted);
  } catch (const AccessRefused&) {  // known a moment ago; what is required next says so
    return false;
  }
}

}  // namespace teletact::service
