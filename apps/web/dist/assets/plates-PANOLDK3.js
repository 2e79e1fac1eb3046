import"./chunk-A7OK6EBF.js";import{o as t,v as e}from"./chunk-E6BSTD65.js";function a(){return t(e,{title:"Plates",text:"This page is being built."})}export{a as Plates};
