/* Replaces functions of the C mathematics library and of BLAS by versions whose results differ in the
 * last bit, as they do between processors and between libraries. A test that fails with this library
 * in LD_PRELOAD and passes without it depends on the last digit of one machine.
 *
 * Half of the results are moved by one unit in the last place, up or down. A hash of the result and of
 * the seed (environment variable PERTURB_SEED, default 1) decides which, so that a call with the same
 * arguments always returns the same result. Whole numbers, infinities and NaN are exact as a rule and
 * stay as they are. scripts/test.sh compiles and uses this file. */
#define _GNU_SOURCE
#include <complex.h>
#include <dlfcn.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef double complex cplx;

static uint64_t seed_bits = 1;

/* Mixes all bits of a word (finalizer of the SplitMix64 generator). */
static uint64_t mixed(uint64_t word)
{
   word = (word ^ (word >> 30)) * 0xBF58476D1CE4E5B9u;
   word = (word ^ (word >> 27)) * 0x94D049BB133111EBu;
   return word ^ (word >> 31);
}

__attribute__((constructor)) static void read_seed(void)
{
   const char *text = getenv("PERTURB_SEED");
   seed_bits = mixed((text ? strtoull(text, NULL, 10) : 1) + 0x9E3779B97F4A7C15u);
}

static double perturbed(double value)
{
   uint64_t bits;
   if (!isfinite(value) || value == rint(value)) return value;
   memcpy(&bits, &value, sizeof bits);
   bits = mixed(bits ^ seed_bits);
   return bits & 1 ? value : nextafter(value, bits & 2 ? HUGE_VAL : -HUGE_VAL);
}

static cplx perturbed_complex(cplx value)
{
   return CMPLX(perturbed(creal(value)), perturbed(cimag(value)));
}

/* The next definition of a function after this library's own. An extension of Python loads BLAS for
 * itself, so that only BLAS's own library shows it. */
static void *original(const char *name)
{
   void *found = dlsym(RTLD_NEXT, name), *blas = NULL;
   if (!found) blas = dlopen("libblas.so.3", RTLD_LAZY);
   if (blas) found = dlsym(blas, name);
   if (found) return found;
   fprintf(stderr, "perturb: no %s behind this library\n", name);
   abort();
}

#define FIND(name, ...) \
   static __typeof__(name) *next; \
   if (!next) next = (__typeof__(name) *)original(#name)

#define OF_REAL(name) \
   double name(double x) { FIND(name); return perturbed(next(x)); }
OF_REAL(exp) OF_REAL(expm1) OF_REAL(log) OF_REAL(log10) OF_REAL(log1p) OF_REAL(cbrt)
OF_REAL(sin) OF_REAL(cos) OF_REAL(tan) OF_REAL(asin) OF_REAL(acos) OF_REAL(atan)
OF_REAL(sinh) OF_REAL(cosh) OF_REAL(tanh) OF_REAL(asinh) OF_REAL(acosh) OF_REAL(atanh)
OF_REAL(erf) OF_REAL(erfc) OF_REAL(tgamma) OF_REAL(lgamma)

#define OF_TWO_REALS(name) \
   double name(double x, double y) { FIND(name); return perturbed(next(x, y)); }
OF_TWO_REALS(pow) OF_TWO_REALS(hypot) OF_TWO_REALS(atan2)

void sincos(double x, double *sine, double *cosine)
{
   FIND(sincos);
   next(x, sine, cosine);
   *sine = perturbed(*sine);
   *cosine = perturbed(*cosine);
}

#define OF_COMPLEX(name) \
   cplx name(cplx z) { FIND(name); return perturbed_complex(next(z)); }
OF_COMPLEX(cexp) OF_COMPLEX(clog) OF_COMPLEX(csqrt) OF_COMPLEX(csinh) OF_COMPLEX(ccosh)
OF_COMPLEX(csin) OF_COMPLEX(ccos)

double cabs(cplx z) { FIND(cabs); return perturbed(next(z)); }

/* BLAS by its Fortran names; lengths of characters come last. */
double ddot_(const int *n, const double *x, const int *x_step, const double *y, const int *y_step)
{
   FIND(ddot_);
   return perturbed(next(n, x, x_step, y, y_step));
}

double dnrm2_(const int *n, const double *x, const int *x_step)
{
   FIND(dnrm2_);
   return perturbed(next(n, x, x_step));
}

static int transposes(const char *how) { return *how != 'N' && *how != 'n'; }

#define MATRIX_VECTOR(name, number, perturb) \
   void name(const char *how, const int *m, const int *n, const number *alpha, const number *a, \
             const int *lda, const number *x, const int *x_step, const number *beta, number *y, \
             const int *y_step, size_t length) \
   { \
      FIND(name); \
      next(how, m, n, alpha, a, lda, x, x_step, beta, y, y_step, length); \
      int size = transposes(how) ? *n : *m; \
      for (int i = 0; i < size; i++) { \
         number *element = y + (size_t)i * abs(*y_step); \
         *element = perturb(*element); \
      } \
   }
MATRIX_VECTOR(dgemv_, double, perturbed)
MATRIX_VECTOR(zgemv_, cplx, perturbed_complex)

#define MATRIX_MATRIX(name, number, perturb) \
   void name(const char *how_a, const char *how_b, const int *m, const int *n, const int *k, \
             const number *alpha, const number *a, const int *lda, const number *b, \
             const int *ldb, const number *beta, number *c, const int *ldc, size_t length_a, \
             size_t length_b) \
   { \
      FIND(name); \
      next(how_a, how_b, m, n, k, alpha, a, lda, b, ldb, beta, c, ldc, length_a, length_b); \
      for (int j = 0; j < *n; j++) \
         for (int i = 0; i < *m; i++) { \
            number *element = c + (size_t)j * *ldc + i; \
            *element = perturb(*element); \
         } \
   }
MATRIX_MATRIX(dgemm_, double, perturbed)
MATRIX_MATRIX(zgemm_, cplx, perturbed_complex)
