// SPDX-License-Identifier: Apache-2.0
//
// cuBLAS, cuBLASLt, cuFFT and cuDNN called from C++: closed libraries that launch kernels of their
// own. math_libraries_equality.py builds this program with nvcc, with each copy of cudart, and
// compares its digests bare and under UrgenGo. It speaks as the Python programs do: the work is
// done in a thread named eq_chain, with --beside next to a busy thread named zz_other, and the last
// line of its output is JSON. Which libraries are there is said by HAVE_* when it is compiled.
//
//   math_libraries [--beside] [--small] [--thread NAME] [--second-runtime HELPER.so]

#include <cuda_runtime.h>
#include <dlfcn.h>
#include <sys/prctl.h>

#include <atomic>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#ifdef HAVE_CUBLAS
#include <cublas_v2.h>
#endif
#ifdef HAVE_CUBLASLT
#include <cublasLt.h>
#endif
#ifdef HAVE_CUFFT
#include <cufft.h>
#endif
#ifdef HAVE_CUDNN
#include <cudnn.h>
#endif

namespace {

using Floats = std::vector<float>;

[[noreturn]] void fail(const char* call, int line, long code) {
    std::fprintf(stderr, "math_libraries.cu:%d: %s answers %ld\n", line, call, code);
    std::exit(1);
}

// Success is 0 in all of these libraries.
#define MUST(call)                                                                              \
    do {                                                                                        \
        const auto status_ = (call);                                                            \
        if (static_cast<long>(status_) != 0) fail(#call, __LINE__, static_cast<long>(status_)); \
    } while (false)

struct Options {
    bool beside = false;
    bool small = false;  // for tools that slow the GPU down a hundred times
    std::string thread = "eq_chain";
    std::string helper;
};

std::string fnv1a(const void* data, std::size_t size) {
    std::uint64_t hash = 14695981039346656037u;
    for (std::size_t i = 0; i < size; ++i) {
        hash = (hash ^ static_cast<const unsigned char*>(data)[i]) * 1099511628211u;
    }
    char text[17];
    std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
    return text;
}

/// An array on the GPU, filled with seeded random numbers or with zeros.
class Array {
  public:
    Array(std::size_t size, cudaStream_t stream, unsigned seed = 0) : size_(size), stream_(stream) {
        MUST(cudaMalloc(&data_, size * sizeof(float)));
        Floats values(size);
        std::minstd_rand random(seed);
        // No distribution of the library: those differ between versions.
        for (float& value : values) {
            value = seed ? static_cast<float>(random() % 2001) / 1000.0f - 1.0f : 0.0f;
        }
        MUST(cudaMemcpyAsync(data_, values.data(), size * sizeof(float), cudaMemcpyHostToDevice,
                             stream));
        MUST(cudaStreamSynchronize(stream));
    }
    Array(const Array&) = delete;
    Array& operator=(const Array&) = delete;
    ~Array() { cudaFree(data_); }

    float* get() const { return data_; }

    std::string digest() const {
        Floats values(size_);
        MUST(cudaMemcpyAsync(values.data(), data_, size_ * sizeof(float), cudaMemcpyDeviceToHost,
                             stream_));
        MUST(cudaStreamSynchronize(stream_));
        return fnv1a(values.data(), size_ * sizeof(float));
    }

  private:
    float* data_ = nullptr;
    std::size_t size_;
    cudaStream_t stream_;
};

struct Result {
    std::vector<std::pair<std::string, std::string>> digests;  // of what, digest
    std::vector<std::pair<std::string, std::string>> versions;
};

__global__ void scale(float* values, std::size_t size, float factor) {
    const std::size_t i = blockIdx.x * static_cast<std::size_t>(blockDim.x) + threadIdx.x;
    if (i < size) values[i] *= factor;
}

void scale_all(const Array& array, std::size_t size, float factor, cudaStream_t stream) {
    scale<<<static_cast<unsigned>((size + 255) / 256), 256, 0, stream>>>(array.get(), size, factor);
    MUST(cudaGetLastError());
}

#ifdef HAVE_CUBLAS
void use_cublas(const Options& options, cudaStream_t stream, Result& result) {
    const int n = options.small ? 128 : 1024, repeats = options.small ? 3 : 30;
    const std::size_t size = static_cast<std::size_t>(n) * n;
    cublasHandle_t handle;
    MUST(cublasCreate(&handle));
    MUST(cublasSetStream(handle, stream));
    MUST(cublasSetMathMode(handle, CUBLAS_PEDANTIC_MATH));
    const float one_over = 1.0f / 16, zero = 0;

    const Array a(size, stream, 1), b(size, stream, 2), c(size, stream);
    const float* left = a.get();
    for (int i = 0; i < repeats; ++i) {
        float* to = i % 2 ? a.get() : c.get();
        MUST(cublasSgemm(handle, CUBLAS_OP_N, CUBLAS_OP_T, n, n, n, &one_over, left, n, b.get(), n,
                         &zero, to, n));
        left = to;
    }
    result.digests.emplace_back("cublasSgemm", (repeats % 2 ? c : a).digest());

    const int m = options.small ? 32 : 128, batch = options.small ? 4 : 64;
    const std::size_t stride = static_cast<std::size_t>(m) * m;
    const Array x(stride * batch, stream, 3), y(stride * batch, stream, 4),
        z(stride * batch, stream);
    for (int i = 0; i < repeats; ++i) {
        MUST(cublasSgemmStridedBatched(handle, CUBLAS_OP_N, CUBLAS_OP_N, m, m, m, &one_over,
                                       x.get(), m, static_cast<long long>(stride), y.get(), m,
                                       static_cast<long long>(stride), &one_over, z.get(), m,
                                       static_cast<long long>(stride), batch));
    }
    result.digests.emplace_back("cublasSgemmStridedBatched", z.digest());
    int version = 0;
    MUST(cublasGetVersion(handle, &version));
    result.versions.emplace_back("cublas", std::to_string(version));
    MUST(cublasDestroy(handle));
}
#endif

#ifdef HAVE_CUBLASLT
void use_cublaslt(const Options& options, cudaStream_t stream, Result& result) {
    const int n = options.small ? 128 : 1024, repeats = options.small ? 3 : 30;
    const std::size_t size = static_cast<std::size_t>(n) * n, workspace_bytes = 4 << 20;
    cublasLtHandle_t handle;
    cublasLtMatmulDesc_t operation;
    cublasLtMatrixLayout_t layout;
    cublasLtMatmulPreference_t preference;
    MUST(cublasLtCreate(&handle));
    MUST(cublasLtMatmulDescCreate(&operation, CUBLAS_COMPUTE_32F, CUDA_R_32F));
    MUST(cublasLtMatrixLayoutCreate(&layout, CUDA_R_32F, n, n, n));
    MUST(cublasLtMatmulPreferenceCreate(&preference));
    MUST(cublasLtMatmulPreferenceSetAttribute(preference, CUBLASLT_MATMUL_PREF_MAX_WORKSPACE_BYTES,
                                              &workspace_bytes, sizeof workspace_bytes));
    cublasLtMatmulHeuristicResult_t choice{};  // a rule, not a measurement
    int num_choices = 0;
    MUST(cublasLtMatmulAlgoGetHeuristic(handle, operation, layout, layout, layout, layout,
                                        preference, 1, &choice, &num_choices));
    if (num_choices == 0) fail("cublasLtMatmulAlgoGetHeuristic finds nothing", __LINE__, 0);

    const Array a(size, stream, 5), b(size, stream, 6), c(size, stream);
    void* workspace = nullptr;
    MUST(cudaMallocAsync(&workspace, workspace_bytes, stream));
    const float alpha = 1.0f / 16, beta = 0.5f;
    for (int i = 0; i < repeats; ++i) {
        MUST(cublasLtMatmul(handle, operation, &alpha, a.get(), layout, b.get(), layout, &beta,
                            c.get(), layout, c.get(), layout, &choice.algo, workspace,
                            workspace_bytes, stream));
    }
    MUST(cudaFreeAsync(workspace, stream));
    result.digests.emplace_back("cublasLtMatmul", c.digest());
    result.versions.emplace_back("cublasLt", std::to_string(cublasLtGetVersion()));
    MUST(cublasLtMatmulPreferenceDestroy(preference));
    MUST(cublasLtMatrixLayoutDestroy(layout));
    MUST(cublasLtMatmulDescDestroy(operation));
    MUST(cublasLtDestroy(handle));
}
#endif

#ifdef HAVE_CUFFT
void use_cufft(const Options& options, cudaStream_t stream, Result& result) {
    const int length = options.small ? 1024 : 1 << 14, batch = options.small ? 2 : 64;
    const int repeats = options.small ? 3 : 20;
    const std::size_t size = std::size_t{2} * length * batch;
    const Array signal(size, stream, 7);
    cufftHandle plan;
    MUST(cufftPlan1d(&plan, length, CUFFT_C2C, batch));
    MUST(cufftSetStream(plan, stream));
    auto* values = reinterpret_cast<cufftComplex*>(signal.get());
    for (int i = 0; i < repeats; ++i) {
        MUST(cufftExecC2C(plan, values, values, CUFFT_FORWARD));
        MUST(cufftExecC2C(plan, values, values, CUFFT_INVERSE));
        scale_all(signal, size, 0.99f / static_cast<float>(length), stream);
    }
    result.digests.emplace_back("cufftExecC2C", signal.digest());
    int version = 0;
    MUST(cufftGetVersion(&version));
    result.versions.emplace_back("cufft", std::to_string(version));
    MUST(cufftDestroy(plan));
}
#endif

#ifdef HAVE_CUDNN
void use_cudnn(const Options& options, cudaStream_t stream, Result& result) {
    const int images = options.small ? 1 : 8, channels = options.small ? 8 : 64;
    const int side = options.small ? 16 : 56, repeats = options.small ? 3 : 20;
    const std::size_t size = static_cast<std::size_t>(images) * channels * side * side;
    cudnnHandle_t handle;
    cudnnTensorDescriptor_t tensor;
    cudnnFilterDescriptor_t filter;
    cudnnConvolutionDescriptor_t convolution;
    MUST(cudnnCreate(&handle));
    MUST(cudnnSetStream(handle, stream));
    MUST(cudnnCreateTensorDescriptor(&tensor));
    MUST(cudnnSetTensor4dDescriptor(tensor, CUDNN_TENSOR_NCHW, CUDNN_DATA_FLOAT, images, channels,
                                    side, side));
    MUST(cudnnCreateFilterDescriptor(&filter));
    MUST(cudnnSetFilter4dDescriptor(filter, CUDNN_DATA_FLOAT, CUDNN_TENSOR_NCHW, channels, channels,
                                    3, 3));
    MUST(cudnnCreateConvolutionDescriptor(&convolution));
    MUST(cudnnSetConvolution2dDescriptor(convolution, 1, 1, 1, 1, 1, 1, CUDNN_CROSS_CORRELATION,
                                         CUDNN_DATA_FLOAT));
    MUST(cudnnSetConvolutionMathType(convolution, CUDNN_FMA_MATH));
    const auto algorithm = CUDNN_CONVOLUTION_FWD_ALGO_IMPLICIT_PRECOMP_GEMM;
    std::size_t workspace_bytes = 0;
    MUST(cudnnGetConvolutionForwardWorkspaceSize(handle, tensor, filter, convolution, tensor,
                                                 algorithm, &workspace_bytes));
    void* workspace = nullptr;
    MUST(cudaMalloc(&workspace, workspace_bytes + 1));
    const Array input(size, stream, 8), output(size, stream);
    const Array weights(static_cast<std::size_t>(channels) * channels * 9, stream, 9);
    const float factor = 0.05f, zero = 0;
    for (int i = 0; i < repeats; ++i) {
        const Array &from = i % 2 ? output : input, &to = i % 2 ? input : output;
        MUST(cudnnConvolutionForward(handle, &factor, tensor, from.get(), filter, weights.get(),
                                     convolution, algorithm, workspace, workspace_bytes, &zero,
                                     tensor, to.get()));
    }
    result.digests.emplace_back("cudnnConvolutionForward", (repeats % 2 ? output : input).digest());
    result.versions.emplace_back("cudnn", std::to_string(cudnnGetVersion()));
    MUST(cudaFree(workspace));
    MUST(cudnnDestroyConvolutionDescriptor(convolution));
    MUST(cudnnDestroyFilterDescriptor(filter));
    MUST(cudnnDestroyTensorDescriptor(tensor));
    MUST(cudnnDestroy(handle));
}
#endif

/// Kernels launched through a second copy of cudart, in a library that is loaded late.
void use_second_runtime(const std::string& helper, Result& result) {
    void* library = dlopen(helper.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        std::fprintf(stderr, "--second-runtime: %s\n", dlerror());
        std::exit(1);
    }
    const auto run = reinterpret_cast<int (*)(float*, int)>(dlsym(library, "second_runtime_run"));
    const auto runtime = reinterpret_cast<void* (*)()>(dlsym(library, "second_runtime_address"));
    if (!run || !runtime) fail("dlsym", __LINE__, 0);
    if (runtime() == reinterpret_cast<void*>(&cudaGetDevice)) {
        std::fprintf(stderr, "--second-runtime: found one copy of cudart, accepted: two\n");
        std::exit(1);
    }
    Floats values(1 << 16);
    MUST(run(values.data(), static_cast<int>(values.size())));
    result.digests.emplace_back("second cudart",
                                fnv1a(values.data(), values.size() * sizeof(float)));
}

void work(const Options& options, Result& result) {
    prctl(PR_SET_NAME, options.thread.c_str(), 0, 0, 0);
    cudaStream_t stream;
    MUST(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
    const std::size_t size = 1 << 16;
    {
        const Array values(size, stream, 10);
        for (int i = 0; i < 20; ++i) scale_all(values, size, 0.9f, stream);
        result.digests.emplace_back("own kernel", values.digest());
    }
#ifdef HAVE_CUBLAS
    use_cublas(options, stream, result);
#endif
#ifdef HAVE_CUBLASLT
    use_cublaslt(options, stream, result);
#endif
#ifdef HAVE_CUFFT
    use_cufft(options, stream, result);
#endif
#ifdef HAVE_CUDNN
    use_cudnn(options, stream, result);
#endif
    if (!options.helper.empty()) use_second_runtime(options.helper, result);
    MUST(cudaStreamDestroy(stream));
}

__global__ void spin(long long cycles) {
    const long long begin = clock64();
    while (clock64() - begin < cycles) {
    }
}

/// The other chain, on its own stream, which keeps the first one waiting.
void keep_busy(const std::atomic<bool>& stop) {
    prctl(PR_SET_NAME, "zz_other", 0, 0, 0);
    cudaStream_t stream;
    MUST(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
    while (!stop) {
        for (int i = 0; i < 20; ++i) spin<<<1056, 256, 0, stream>>>(60'000);  // about 30 us each
        MUST(cudaGetLastError());
        MUST(cudaStreamSynchronize(stream));
    }
    MUST(cudaStreamDestroy(stream));
}

void print(const Result& result) {
    const auto pairs = [](const auto& list) {
        std::string text;
        for (const auto& [name, value] : list) {
            text += (text.empty() ? "\"" : ", \"") + name + "\": \"" + value + "\"";
        }
        return "{" + text + "}";
    };
    std::string digests;
    for (const auto& [name, value] : result.digests) {
        digests += (digests.empty() ? "\"" : ", \"") + name + " " + value + "\"";
    }
    std::printf("{\"digests\": [%s], \"packages\": %s}\n", digests.c_str(),
                pairs(result.versions).c_str());
}

}  // namespace

int main(int argc, char** argv) {
    Options options;
    for (int i = 1; i < argc; ++i) {
        const std::string argument = argv[i];
        if (argument == "--beside") {
            options.beside = true;
        } else if (argument == "--small") {
            options.small = true;
        } else if (argument == "--thread" && i + 1 < argc) {
            options.thread = argv[++i];
        } else if (argument == "--second-runtime" && i + 1 < argc) {
            options.helper = argv[++i];
        } else {
            std::fprintf(stderr,
                         "found %s, accepted: --beside --small --thread NAME "
                         "--second-runtime HELPER.so\n",
                         argv[i]);
            return 2;
        }
    }
    Result result;
    std::atomic<bool> stop{false};
    std::thread busy;
    if (options.beside) busy = std::thread([&] { keep_busy(stop); });
    std::thread(work, std::cref(options), std::ref(result)).join();
    stop = true;
    if (busy.joinable()) busy.join();
    print(result);
    return 0;
}
