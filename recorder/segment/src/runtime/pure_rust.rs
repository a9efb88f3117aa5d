//! `rten`: nothing to install.

use super::{Engine, Loader, RuntimeInfo};
use crate::Tensor;
use crate::description::Model;
use rten::{ModelOptions, NodeId, RunOptions, ThreadPool};
use rten_tensor::prelude::*;
use std::sync::Arc;

/// The crate does not tell its own version; a test holds this one to `Cargo.lock`.
const VERSION: &str = "0.27.0";

pub fn info() -> RuntimeInfo {
    RuntimeInfo { name: "rten".to_owned(), version: VERSION.to_owned(), library: None }
}

struct Network {
    model: rten::Model,
    input: NodeId,
    outputs: Vec<NodeId>,
    threads: Arc<ThreadPool>,
}

pub struct PureRust;

impl Loader for PureRust {
    fn load(&self, model: &Model) -> Result<Box<dyn Engine>, String> {
        network(model).map(|network| Box::new(network) as Box<dyn Engine>)
    }
}

fn network(model: &Model) -> Result<Network, String> {
    let graph = ModelOptions::with_all_ops().load_file(&model.file).map_err(|error| error.to_string())?;
    let node = |name: &str| {
        let names = |ids: &[NodeId]| -> Vec<String> {
            ids.iter().filter_map(|id| graph.node_info(*id)?.name().map(str::to_owned)).collect()
        };
        let (inputs, outputs) = (names(graph.input_ids()), names(graph.output_ids()));
        graph.find_node(name).ok_or_else(|| format!("has no tensor `{name}`; inputs {inputs:?}, outputs {outputs:?}"))
    };
    let input = node(&model.description.input.tensor)?;
    let outputs = model.description.outputs().into_iter().map(node).collect::<Result<_, _>>()?;
    Ok(Network { model: graph, input, outputs, threads: Arc::new(ThreadPool::with_num_threads(1)) })
}

impl Engine for Network {
    fn run(&mut self, input: Tensor) -> Result<Vec<Tensor>, String> {
        let input = rten_tensor::Tensor::from_data(input.shape.as_slice(), input.data);
        let options = RunOptions::default().with_thread_pool(Some(Arc::clone(&self.threads)));
        let inputs = vec![(self.input, input.into())];
        let values = self.model.run(inputs, &self.outputs, Some(options)).map_err(|error| error.to_string())?;
        let tensor = |value: rten::Value| {
            let tensor = value.into_tensor::<f32>().ok_or("an output is not of 32-bit floats")?;
            Tensor::new(tensor.shape().to_vec(), tensor.into_data()).ok_or_else(|| "an output is not dense".to_owned())
        };
        values.into_iter().map(tensor).collect()
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_version_that_stands_in_logs_is_the_one_that_runs() {
        let lock = include_str!("../../../../Cargo.lock");
        let entry = lock.split("[[package]]").find(|entry| entry.contains("\nname = \"rten\"\n")).unwrap();
        assert!(entry.contains(&format!("\nversion = \"{}\"\n", super::VERSION)), "{entry}");
    }
}
