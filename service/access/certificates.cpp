#include "service/access/certificates.h"

#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <ctime>
#include <memory>
#include <stdexcept>

namespace teletact::service {

namespace {

template <auto kFree>
struct Free {
  template <class T>
  void operator()(T* freed) const {
    kFree(freed);
  }
};
using Bio = std::unique_ptr<BIO, Free<BIO_free_all>>;
using Key = std::unique_ptr<EVP_PKEY, Free<EVP_PKEY_free>>;
using Certificate = std::unique_ptr<X509, Free<X509_free>>;

Bio reading(const std::string& pem) {
  return Bio(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())));
}

Certificate certificate_in(const std::string& pem) {
  Certificate certificate(PEM_read_bio_X509(reading(pem).get(), nullptr, nullptr, nullptr));
  if (!certificate) throw std::runtime_error("no certificate can be read in it");
  return certificate;
}

// A key with a passphrase is none: nobody is there to type it.
Key key_in(const std::string& pem) {
  const auto no_passphrase = [](char*, int, int, void*) { return 0; };
  Key key(PEM_read_bio_PrivateKey(reading(pem).get(), nullptr, no_passphrase, nullptr));
  if (!key) throw std::runtime_error("no private key without a passphrase can be read in it");
  return key;
}

}  // namespace

void require_pair(const std::string& certificate, const std::string& key) {
  const Certificate shown = certificate_in(certificate);
  const Key secret = key_in(key);
  if (X509_check_private_key(shown.get(), secret.get()) != 1)
    throw std::runtime_error("the key is not the certificate's");
}

WallClock::time_point end_of(const std::string& pem) {
  const Certificate certificate = certificate_in(pem);
  std::tm end{};
  if (ASN1_TIME_to_tm(X509_get0_notAfter(certificate.get()), &end) != 1)
    throw std::runtime_error("the certificate does not say when it ends");
  return WallClock::from_time_t(timegm(&end));
}

}  // namespace teletact::service
