import"./chunk-A7OK6EBF.js";import{o as e,v as i}from"./chunk-E6BSTD65.js";function g(){return e(i,{title:"ApiPage",text:"This page is being built."})}export{g as ApiPage};
