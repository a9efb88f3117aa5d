//! ONNX Runtime through `ort`: the fast one, its library found at run time.

use super::{Engine, Loader, RuntimeInfo};
use crate::description::Model;
use crate::{SegmentError, Tensor};
use ort::environment::Environment;
use ort::session::Session;
use std::ffi::{CStr, c_char, c_void};
use std::path::{Path, PathBuf};

/// The library, loaded.
pub struct OnnxRuntime(Environment);

pub fn open(candidates: &[PathBuf]) -> Result<(RuntimeInfo, OnnxRuntime), SegmentError> {
    let names = || candidates.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ");
    let library = candidates.iter().find(|path| path.is_file()).ok_or_else(|| {
        SegmentError::Runtime(format!(
            "no ONNX Runtime: looked for {}; name its library with --onnxruntime or ORT_DYLIB_PATH (docs/segmentation.md \
             says where to get it), or use --runtime rten",
            if candidates.is_empty() { "nothing".to_owned() } else { names() }
        ))
    })?;
    let unusable = |error: &dyn std::fmt::Display| {
        let library = library.display();
        SegmentError::Runtime(format!("{library} cannot be used as ONNX Runtime: {error}; 1.24 or newer is needed"))
    };
    let builder = ort::init_from(library).map_err(|error| unusable(&error))?;
    let environment = builder.with_name("pslam").with_telemetry(false).build().map_err(|error| unusable(&error))?;
    let version = version(library).map_err(|error| unusable(&error))?;
    let info = RuntimeInfo { name: "onnxruntime".to_owned(), version, library: Some(library.clone()) };
    Ok((info, OnnxRuntime(environment)))
}

/// The start of `OrtApiBase`, ONNX Runtime's one exported structure (`onnxruntime_c_api.h`).
#[repr(C)]
struct ApiBase {
    get_api: *const c_void,
    get_version_string: unsafe extern "C" fn() -> *const c_char,
}

/// The library's version: `ort` checks it and keeps it to itself.
fn version(library: &Path) -> Result<String, libloading::Error> {
    // SAFETY: the library has been loaded as ONNX Runtime by `ort` and stays so; loading it again runs nothing.
    let library = unsafe { libloading::Library::new(library) }?;
    // SAFETY: the C header declares this function so, and `ort` has called it.
    let api_base = unsafe { library.get::<unsafe extern "C" fn() -> *const ApiBase>(b"OrtGetApiBase") }?;
    // SAFETY: it returns a static structure, whose second member returns a static text that ends with a zero.
    let text = unsafe { CStr::from_ptr(((*api_base()).get_version_string)()) };
    Ok(text.to_string_lossy().into_owned())
}

struct Network {
    session: Session,
    input: String,
    outputs: Vec<String>,
}

impl Loader for OnnxRuntime {
    fn load(&self, model: &Model) -> Result<Box<dyn Engine>, String> {
        network(&self.0, model).map(|network| Box::new(network) as Box<dyn Engine>)
    }
}

fn network(environment: &Environment, model: &Model) -> Result<Network, String> {
    let open = || -> Result<Session, ort::Error> {
        Session::builder(environment)?.with_intra_threads(1)?.commit_from_file(&model.file)
    };
    let session = open().map_err(|error| error.to_string())?;
    let inputs: Vec<String> = session.inputs().iter().map(|outlet| outlet.name().to_owned()).collect();
    let given: Vec<String> = session.outputs().iter().map(|outlet| outlet.name().to_owned()).collect();
    let outputs: Vec<String> = model.description.outputs().into_iter().map(str::to_owned).collect();
    let input = model.description.input.tensor.clone();
    let missing = std::iter::once(&input).filter(|name| !inputs.contains(name));
    let missing = missing.chain(outputs.iter().filter(|name| !given.contains(name))).next();
    if let Some(name) = missing {
        return Err(format!("has no tensor `{name}`; inputs {inputs:?}, outputs {given:?}"));
    }
    Ok(Network { session, input, outputs })
}

impl Engine for Network {
    fn run(&mut self, input: Tensor) -> Result<Vec<Tensor>, String> {
        let text = |error: ort::Error| error.to_string();
        let value = ort::value::Tensor::from_array((input.shape, input.data)).map_err(text)?;
        let outputs = self.session.run(ort::inputs![self.input.as_str() => value]).map_err(text)?;
        let tensor = |name: &String| {
            let value = outputs.get(name).ok_or_else(|| format!("gave no `{name}`"))?;
            let (shape, data) = value.try_extract_tensor::<f32>().map_err(text)?;
            let shape = shape.iter().map(|extent| usize::try_from(*extent).unwrap_or(0)).collect();
            Tensor::new(shape, data.to_vec()).ok_or_else(|| format!("`{name}` does not fill its shape"))
        };
        self.outputs.iter().map(tensor).collect()
    }
}
